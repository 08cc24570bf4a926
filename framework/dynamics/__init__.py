"""What the motion costs: generalised forces, deflections, motor torques."""
