"""Models on the Hugging Face Hub: `hf://user/repo`, with `@revision` for another one than the newest.

A repository is the folder that `BindingModel.save` writes. `PyTorchModelHubMixin` is not followed: it wants its
constants in config.json and builds a class from them, while a model here is chosen by its config.toml.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ndtorch.errors import InputError
from ndtorch.utils.packages import need

SCHEME = "hf://"

FILES = ["config.toml", "weights.safetensors", "README.md"]
"""What is fetched of a repository; all else is left there."""

TAGS = "---\nlibrary_name: ndtorch\ntags: [ndtorch, visual-binding]\n---\n\n"
"""What the Hub reads of a card."""


def is_hub_address(model: object) -> bool:
    """Whether it names a model on the Hub."""
    return isinstance(model, str) and model.startswith(SCHEME)


def repository(address: str) -> tuple[str, str | None]:
    """The repository `user/repo` and the revision of an address.

    Raises:
        InputError: another form.

    >>> repository("hf://user/repo@v1")
    ('user/repo', 'v1')
    """
    found = re.fullmatch(r"hf://([\w.-]+/[\w.-]+)(?:@([\w./-]+))?", address)
    if found is None:
        raise InputError(f"a model on the Hub is hf://user/repo or hf://user/repo@revision, got {address!r}")
    return found[1], found[2]


def download_model(address: str) -> Path:
    """The folder of a model on the Hub, fetched, or from the cache where it is there or HF_HUB_OFFLINE is set."""
    repo, revision = repository(address)
    hub = need("huggingface_hub", "a model on the Hub")
    folder = ask(address, hub.snapshot_download, repo_id=repo, revision=revision, allow_patterns=FILES)
    return Path(folder)


def upload_model(save: Callable[[Path], object], address: str) -> None:
    """Write a model, which `save` writes into a folder, to the Hub: the repository is made, private, where there is
    none. A card that is there is kept.
    """
    repo, revision = repository(address)
    hub = need("huggingface_hub", "a model on the Hub")
    with tempfile.TemporaryDirectory() as beside:
        folder = Path(beside, repo.split("/")[1])
        save(folder)
        api = hub.HfApi()
        ask(address, api.create_repo, repo, private=True, exist_ok=True)
        card = folder / "README.md"
        card.write_text(TAGS + card.read_text(encoding="utf-8"), encoding="utf-8")
        if ask(address, api.file_exists, repo, card.name, revision=revision):
            card.unlink()
        ask(address, api.upload_folder, repo_id=repo, folder_path=folder, revision=revision)


def ask(address: str, call: Any, *args: Any, **options: Any) -> Any:
    """What the Hub answers; `InputError` of one line where it refuses or is not there."""
    try:
        return call(*args, **options)
    except (OSError, ValueError) as error:  # the base classes of the errors of huggingface_hub
        raise InputError(f"{address}: {' '.join(str(error).split())[:300]}") from None
