"""Maps of a robot over its workspace, and studies of its dimensions."""
