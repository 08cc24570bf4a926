"""Andrews' squeezer to more than 15 digits, by two programs that share nothing.

Not run in the chart, which reads what they wrote to `data/andrews_squeezer/angles.txt`:
`python -m tests.benchmarks.chart.squeezer`.
"""
