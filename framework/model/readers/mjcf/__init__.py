"""The reader of MJCF, MuJoCo's XML, one file an idea. Open `reader` first."""
