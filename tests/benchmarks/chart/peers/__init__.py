"""The 5R in other simulators, built from plain numbers: nothing of the framework but the arrays."""
