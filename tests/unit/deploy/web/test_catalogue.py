"""What a page may ask for by name, and nothing else."""

import pytest

from railctl.common.strict import ConfigError
from railctl.deploy.web.catalogue import catalogue_of


@pytest.mark.parametrize(
    "name",
    [
        "..",
        ".",
        "",
        "../one",
        "a/../../one",
        "/etc",
        "one/",
        "/one",
        "one\0",
        "~",
        "%2e%2e",
        "a/b/c/d/e",
        ".levels",
        "x" * 300,
    ],
)
def test_what_is_no_name_is_refused(make, name):
    make("one")
    catalogue = catalogue_of([])
    for find in (catalogue.run, catalogue.study):
        with pytest.raises(ConfigError):
            find(name)


def test_runs_are_found_in_the_folder_of_runs_alone(make, root, tmp_path, monkeypatch):
    inside, outside = make("one"), make("outside")
    (tmp_path / "elsewhere").mkdir()
    outside.path.rename(tmp_path / "elsewhere" / "two")
    monkeypatch.chdir(tmp_path / "elsewhere")
    catalogue = catalogue_of([])
    assert catalogue.run("one") == inside
    with pytest.raises(ConfigError, match="no run named two"):
        catalogue.run("two")


def test_runs_of_a_study_have_the_names_of_their_folders(make):
    folder = make("mini/runs/ppo-easy-1")
    assert catalogue_of([]).run("mini/runs/ppo-easy-1") == folder
    assert catalogue_of(["mini/runs/ppo-easy-1"]).named == [("run", "mini/runs/ppo-easy-1")]


def test_a_run_that_the_command_names_may_lie_anywhere(make, tmp_path):
    folder = make("one")
    elsewhere = tmp_path / "two"
    folder.path.rename(elsewhere)
    catalogue = catalogue_of([str(elsewhere)])
    assert catalogue.named == [("run", "two")]
    assert catalogue.run("two").path == elsewhere
    assert [run["run"] for run in catalogue.documents()["runs"]] == ["two"]


def test_a_file_is_no_study_whatever_its_name_ends_in(make, tmp_path, monkeypatch):
    (tmp_path / "mine.yaml").write_text("contenders: [dqn]\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=r"no study named mine\.yaml"):
        catalogue_of([]).study("mine.yaml")


def test_a_study_that_was_not_started_says_how_to_start_it(root):
    with pytest.raises(ConfigError, match="railctl study run thesis-mini"):
        catalogue_of(["thesis-mini"])


def test_a_study_that_is_wrong_is_listed_with_what_is_wrong(root):
    (root / "bad").mkdir()
    (root / "bad" / "study.yaml").write_text("contenders: []\n")
    [study] = catalogue_of([]).documents()["studies"]
    assert study["study"] == "bad"
    assert "contenders" in study["wrong"]
