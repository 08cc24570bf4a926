"""Where people look: figures, and pages for the browser. The only place that knows matplotlib and MeshCat."""

from framework.errors import InvalidInput

try:
    import matplotlib  # noqa: F401  reads the environment as it is imported
except ValueError as error:
    raise InvalidInput(f"MPLBACKEND: {error}") from None
