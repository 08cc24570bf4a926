"""Where people look: figures. The only place that knows matplotlib."""
