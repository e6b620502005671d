"""One thread and fixed seeds for every test: two threads collapse when the other core is busy."""

import pytest
import torch

torch.set_num_threads(1)


@pytest.fixture(autouse=True)
def fixed_seed() -> None:
    """The same random numbers whatever ran before."""
    torch.manual_seed(0)
