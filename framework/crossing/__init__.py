"""Condition (8) put to work: laws that carry a robot through its Type 2 singularities."""
