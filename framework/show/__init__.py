"""Where people look: figures, and pages for the browser. The only place that knows matplotlib and MeshCat."""
