"""Linear algebra that numpy and scipy lack, and that knows no robot."""
