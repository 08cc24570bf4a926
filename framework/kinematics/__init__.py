"""How the robot moves: closures, assembly, A, B, C, singularities and the path's singular points."""
