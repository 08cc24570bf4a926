"""Every reason to say no to a plan, in the order in which they are asked.

Open `reasons` first: it is the table of all of them, each with its question, its error and the function that
decides it, here or in the packages below. What was given and cannot be right is refused before
(`planning.options`, `planning.request`: InvalidInput).

    reasons              the table
    turning_back         laws that run backwards or leave the path
    explanation          what a refusal says beside its reason, what to ask for instead, limits to be kept
    refusal_proofs       the numbers on which a refusal rests
"""
