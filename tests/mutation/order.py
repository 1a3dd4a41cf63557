"""A plugin of pytest that runs only the tests in a file, in the order of its lines; `run` uses it for mutants."""

import os
from pathlib import Path


def pytest_collection_modifyitems(config, items) -> None:
    order = {name: index for index, name in enumerate(Path(os.environ["LOOKDEV_TEST_ORDER"]).read_text().splitlines())}
    left_out = [item for item in items if item.nodeid not in order]
    config.hook.pytest_deselected(items=left_out)
    items[:] = sorted((item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid])
