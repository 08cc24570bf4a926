"""Speed against accuracy: every method in one run, against references that share no code with it."""
