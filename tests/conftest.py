"""One thread for every test: two threads collapse when the other core is busy."""

import torch

torch.set_num_threads(1)
