"""How a planned crossing is driven by a motor controller, and what happens when the model is wrong."""
