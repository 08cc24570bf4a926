"""Where the motors lose hold: measure, rank deficiency, points on a path, classes, the locus."""
