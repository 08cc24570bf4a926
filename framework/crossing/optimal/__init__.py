"""The optimal law: the cone program and what is around it."""
