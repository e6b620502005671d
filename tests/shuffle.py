"""A plugin for pytest: an order of chance, the same for the same seed. Quick tests still come before slow ones."""

from __future__ import annotations

import random

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--shuffle", type=int, default=None, metavar="SEED", help="run the tests in an order of chance")


def pytest_report_header(config: pytest.Config) -> str:
    return f"shuffled with seed {config.getoption('--shuffle')}"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Before conftest sorts by markers, which keeps this order among equals."""
    seed = config.getoption("--shuffle")
    if seed is not None:
        random.Random(seed).shuffle(items)
