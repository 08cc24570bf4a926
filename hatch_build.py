"""Project URLs: of the paper, and of the repository whose workflow builds the package."""

from __future__ import annotations

import os
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface


class ProjectUrls(MetadataHookInterface):
    """Write the addresses that a workflow of GitHub knows; a clone knows none."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set `urls`."""
        metadata["urls"] = {"Paper": "https://hal.science/hal-00469600"}
        repository = os.environ.get("GITHUB_REPOSITORY", "")
        if repository:
            owner, _, name = repository.partition("/")
            source = f"{os.environ.get('GITHUB_SERVER_URL', 'https://github.com')}/{repository}"
            site = f"https://{owner.lower()}.github.io/{name}/"
            metadata["urls"] |= {
                "Source": source,
                "Documentation": site,
                "Changelog": f"{site}changelog.html",
            }
