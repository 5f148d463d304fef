"""railctl place and railctl study place: what is printed, and that nothing is before all is checked."""

import pytest
import yaml
from command_line import complaint, railctl

from railctl.common.rules.settings import NetworkConfig
from railctl.common.task import WRONG_USAGE

PLACED = ("--nodes", 3, "--actors-per-node", "easy=2")


@pytest.fixture(autouse=True)
def runs(tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path / "runs"))
    return tmp_path / "runs"


def test_a_script_for_slurm_names_the_run_and_its_folder(runs):
    done = railctl("place", "slurm", *PLACED, "--name", "one", "--lag", 3, "--set", "evaluation.levels=2")
    assert done.exit_code == 0
    assert f"export RAILCTL_RUNS={runs}\n" in done.stdout
    assert "run_file='lag: 3\nevaluation:\n  levels: 2\n'" in done.stdout
    assert not runs.exists()  # nothing is started or made


def test_a_run_without_a_name_gets_one_that_stays():
    script = railctl("place", "slurm", *PLACED, "--algorithm", "ppo").stdout
    [name] = [line.removeprefix("#SBATCH --job-name=") for line in script.splitlines() if "--job-name" in line]
    assert name.startswith("ppo-easy-seed1-")
    assert f" --name {name} " in script


def test_manifests_for_kubernetes_name_image_and_port():
    done = railctl("place", "kubernetes", *PLACED, "--name", "one", "--image", "railctl:1", "--port", 7000)
    jobs = [document for document in yaml.safe_load_all(done.stdout) if document["kind"] == "Job"]
    containers = [job["spec"]["template"]["spec"]["containers"][0] for job in jobs]
    assert [container["image"] for container in containers] == ["railctl:1"] * 2
    assert containers[1]["args"][1] == "tls/one:7000"


def test_files_that_a_run_names_are_found_by_slurms_nodes_and_by_no_pod(tmp_path, write_checkpoint):
    (tmp_path / "mine").mkdir()
    network = NetworkConfig(kind="actor-critic")
    write_checkpoint(tmp_path / "mine" / "one.safetensors", network)
    file = tmp_path / "mine" / "run.yaml"
    given = {"algorithm": "ppo", "network": network.model_dump(mode="json"), "start_from": "one.safetensors"}
    file.write_text(yaml.safe_dump(given))
    script = railctl("place", "slurm", *PLACED, "-f", file, "--name", "one").stdout
    assert f"checkpoint: {tmp_path}/mine/one.safetensors" in script
    said = complaint(WRONG_USAGE, "place", "kubernetes", *PLACED, "-f", file, "--name", "one", "--image", "x")
    assert said.startswith("railctl: start_from: pods do not see files of this machine")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["slurm", *PLACED, "--episodes", 0], "episodes: input should be greater than or equal to 1, not 0"),
        (["slurm", *PLACED, "--set", "dqn.batch=3"], "unknown key dqn.batch: did you mean batch_size? "),
        (["slurm", "--nodes", 3, "--actors-per-node", "easy"], "actors 'easy' is not level=count"),
        (["slurm", *PLACED, "--image", "x"], "--image x: nodes of Slurm have railctl on their path, leave it out"),
        (["kubernetes", *PLACED, "--name", "one"], "--image is missing: "),
        (["kubernetes", *PLACED, "--image", "x", "--name", "One"], "--name 'One': Kubernetes wants"),
    ],
)
def test_wrong_usage_is_one_line_and_prints_nothing_else(arguments, text):
    assert complaint(WRONG_USAGE, "place", *arguments).startswith(f"railctl: {text}")


def test_another_site_is_refused():
    done = railctl("place", "nomad", *PLACED)
    assert (done.exit_code, done.stdout) == (WRONG_USAGE, "")


def test_a_script_for_a_study_shares_it_out():
    script = railctl("study", "place", "thesis-mini", "--shares", 2, "--cores", 1).stdout
    assert "#SBATCH --array=1-2\n" in script
    assert (
        'work=(railctl study run thesis-mini --name thesis-mini --share "$SLURM_ARRAY_TASK_ID"/2 --cores 1)' in script
    )


def test_wrong_usage_of_a_study_is_one_line():
    said = complaint(WRONG_USAGE, "study", "place", "thesis-mini", "--shares", 1000)
    assert said.startswith("railctl: --shares 1000: study thesis-mini has ")
    said = complaint(WRONG_USAGE, "study", "run", "thesis-mini", "--share", "0/8")
    assert said == "railctl: --share '0/8': write I/N, with I from 1 to N, as 2/8"
