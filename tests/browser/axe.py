"""axe-core, which looks for what not everybody can read or reach."""

import json
from pathlib import Path

from playwright.sync_api import Page

AXE = Path(__file__).parents[1] / "node" / "node_modules" / "axe-core" / "axe.min.js"


def findings(page: Page, part: str = "html") -> list[str]:
    """Return what axe-core finds serious or critical in a part of the page."""
    result = page.evaluate("part => axe.run(part, {resultTypes: ['violations']})", part)
    return [
        f"{one['id']}: {json.dumps([node['target'] for node in one['nodes']])}"
        for one in result["violations"]
        if one["impact"] in ("serious", "critical")
    ]
