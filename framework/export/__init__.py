"""What other programs read: a simulator's model of a robot, a controller's trajectory out of a plan."""
