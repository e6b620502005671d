"""Models on the Hub, without a network: a hub of folders, laid out as the cache of `huggingface_hub` is."""

import fnmatch
import sys
from pathlib import Path

import pytest
import torch

import ndtorch
from ndtorch.binding.hub import repository
from ndtorch.errors import InputError


class Hub:
    """`huggingface_hub`, as far as it is used: files of repositories are blobs, and snapshots link to them."""

    def __init__(self, root):
        self.root, self.repos, self.made = root, {}, []
        self.HfApi = lambda: self

    def snapshot_download(self, repo_id, revision=None, allow_patterns=None):
        if repo_id not in self.repos:
            raise OSError(f"404 Client Error.\n\nRepository Not Found for url: {repo_id}")
        cache = self.root / f"models--{repo_id.replace('/', '--')}"
        snapshot = cache / "snapshots" / (revision or "main")
        for name, data in self.repos[repo_id].items():
            if any(fnmatch.fnmatch(name, pattern) for pattern in allow_patterns):
                blob, link = cache / "blobs" / str(abs(hash(data))), snapshot / name
                for place in (blob, link):
                    place.parent.mkdir(parents=True, exist_ok=True)
                blob.write_bytes(data)
                link.symlink_to(blob)
        return str(snapshot)

    def create_repo(self, repo_id, private, exist_ok):
        assert exist_ok
        self.made.append((repo_id, private))
        self.repos.setdefault(repo_id, {})

    def file_exists(self, repo_id, filename, revision=None):
        return filename in self.repos[repo_id]

    def upload_folder(self, repo_id, folder_path, revision=None):
        self.repos[repo_id] |= {file.name: file.read_bytes() for file in Path(folder_path).iterdir()}


@pytest.fixture
def hub(tmp_path, monkeypatch):
    made = Hub(tmp_path)
    monkeypatch.setitem(sys.modules, "huggingface_hub", made)
    return made


def test_a_model_comes_back_equal(hub, tmp_path):
    """Config and weights, to the bit; the same files as of a folder that is saved here."""
    model = ndtorch.load("published", size=(40, 40), fps=50, tau_motion_low=0.06)
    model.save("hf://someone/my-model")
    model.save(tmp_path / "my-model")
    for file in (tmp_path / "my-model").iterdir():
        data = hub.repos["someone/my-model"][file.name]
        assert data.endswith(file.read_bytes())
        assert data == file.read_bytes() or file.name == "README.md"
    assert hub.repos["someone/my-model"]["README.md"].startswith(b"---\nlibrary_name: ndtorch\n")
    assert hub.made == [("someone/my-model", True)]
    hub.repos["someone/my-model"]["large.bin"] = b"left there"
    again = ndtorch.load("hf://someone/my-model@v2")
    assert not list(tmp_path.glob("models--*/snapshots/*/large.bin"))
    assert again.config == model.config
    assert torch.equal(again.first_stage(), model.first_stage())
    assert ndtorch.load("hf://someone/my-model", fps=25).fps == 25


def test_a_card_that_is_there_is_kept(hub):
    hub.repos["someone/my-model"] = {"README.md": b"mine"}
    ndtorch.load("scale-free").save("hf://someone/my-model")
    assert hub.repos["someone/my-model"]["README.md"] == b"mine"
    assert "config.toml" in hub.repos["someone/my-model"]


def test_what_the_hub_says_is_one_line(hub):
    with pytest.raises(InputError, match=r"^hf://no/body: 404 Client Error\. Repository Not Found for url: no/body$"):
        ndtorch.load("hf://no/body")
    hub.repos["some/text"] = {"notes.txt": b""}
    hub.snapshot_download("some/text", allow_patterns=["*"])
    with pytest.raises(InputError, match="no such file"):
        ndtorch.load("hf://some/text")


@pytest.mark.parametrize("address", ["hf://alone", "hf://a/b/c", "hf://a b/c", "hf://a/b@", "hf://"])
def test_bad_addresses(address):
    with pytest.raises(InputError, match="is hf://user/repo or hf://user/repo@revision"):
        repository(address)


def test_without_the_package_the_words_that_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(InputError, match="a model on the Hub needs huggingface_hub, which is not installed"):
        ndtorch.load("hf://a/b")


def test_other_names_are_no_addresses():
    with pytest.raises(InputError, match="is not a model folder"):
        ndtorch.load("https://huggingface.co/a/b")
