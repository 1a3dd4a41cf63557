"""A plugin of pytest that runs the tests of a list, in its order."""

import os
from pathlib import Path


def pytest_collection_modifyitems(config, items) -> None:
    order = {name: place for place, name in enumerate(Path(os.environ["LOOKDEV_TEST_ORDER"]).read_text().splitlines())}
    left_out = [item for item in items if item.nodeid not in order]
    config.hook.pytest_deselected(items=left_out)
    items[:] = sorted((item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid])
