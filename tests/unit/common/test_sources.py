"""The digest of sources is kept, and never when anything may have changed."""

import json
import os
import subprocess
from pathlib import Path

import pytest

from railctl.common import sources
from railctl.common.interpreter import PYTHON


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Files that import one another; they are not fresh any more."""
    monkeypatch.setattr(sources, "PACKAGE", tmp_path / "package")
    monkeypatch.setattr(sources, "SETTLED_S", 0.0)
    package = tmp_path / "package"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "top.py").write_text("import math\nfrom package.middle import a\n")
    (package / "middle.py").write_text("from package import bottom\n\na = bottom\n")
    (package / "bottom.py").write_text("A = 1\n")
    (tmp_path / "cache").mkdir()
    return tmp_path


def digest(tree: Path) -> bytes:
    """As the next process finds it."""
    sources._stamp.cache_clear()
    sources._imports.cache_clear()
    return sources.digest(tree / "package" / "top.py", tree / "cache" / "top.sources.json")


def test_what_has_not_changed_is_not_read_again(tree: Path, monkeypatch: pytest.MonkeyPatch):
    first = digest(tree)
    monkeypatch.setattr(sources, "_reach", lambda _source: pytest.fail("parsed again"))
    assert digest(tree) == first


def test_a_change_is_seen_whatever_its_time_and_size(tree: Path):
    first, bottom = digest(tree), tree / "package" / "bottom.py"
    before = bottom.stat()
    bottom.write_text("A = 2\n")
    os.utime(bottom, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert bottom.stat().st_size == before.st_size
    second = digest(tree)
    assert second != first
    bottom.write_text("A = 1\n")
    assert digest(tree) == first  # what is in the files counts, not when they were written


@pytest.mark.parametrize("fresh", ["package/math.py", "package/math/__init__.py", "package/bottom/__init__.py"])
def test_a_file_that_comes_to_be_is_seen(tree: Path, fresh: str):
    first = digest(tree)
    (tree / fresh).parent.mkdir(exist_ok=True)
    (tree / fresh).write_text("A = 3\n")
    assert digest(tree) != first


def test_what_is_installed_beside_the_package_is_not_ours(tree: Path):
    first = digest(tree)
    (tree / "math.py").write_text("A = 4\n")
    assert digest(tree) == first
    watched = json.loads((tree / "cache" / "top.sources.json").read_text())["stamps"]
    assert all(path.startswith(str(tree / "package")) for path in watched)


def test_what_changed_just_before_is_not_trusted(tree: Path, monkeypatch: pytest.MonkeyPatch):
    """Within one tick of the file system's clock it might change again and look the same."""
    monkeypatch.setattr(sources, "SETTLED_S", 60.0)
    assert digest(tree) == digest(tree)
    assert list((tree / "cache").iterdir()) == []


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"stamps": {}}', '{"stamps": {}, "digest": "xyz"}'])
def test_a_damaged_memo_is_made_anew(tree: Path, content: str):
    first, memo = digest(tree), tree / "cache" / "top.sources.json"
    whole = json.loads(memo.read_text())
    memo.write_text(content)
    assert digest(tree) == first
    assert json.loads(memo.read_text()) == whole


def test_without_a_place_for_memos_all_goes_on(tree: Path):
    first = digest(tree)
    assert sources.digest(tree / "package" / "top.py", tree / "nowhere" / "top.json") == first


def test_processes_agree(tree: Path):
    code = (
        "import sys; from pathlib import Path; from railctl.common import sources;"
        "sources.PACKAGE = Path(sys.argv[1], 'package');"
        "print(sources.digest(Path(sys.argv[1], 'package', 'top.py'), Path(sys.argv[1], 'cache', 'other')).hex())"
    )
    said = subprocess.run([*PYTHON, "-c", code, str(tree)], capture_output=True, text=True, check=True).stdout
    assert bytes.fromhex(said) == digest(tree)
