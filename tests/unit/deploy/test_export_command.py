"""railctl export, from the command line to what is asked of the process that writes."""

import pytest
from command_line import complaint, railctl

from railctl.common.requests import ExportRequest
from railctl.deploy.commands import export
from railctl.deploy.runs import find_checkpoint

NAME = "pretrained/dispatch-easy"


@pytest.fixture
def asked(monkeypatch, tmp_path):
    """What processes were asked; they answer at once."""
    monkeypatch.chdir(tmp_path)
    requests = []

    def answer(module, request):
        requests.append((module, ExportRequest.model_validate_json(request)))
        ends = {"inputs": {"observation": [391]}, "outputs": {"value": []}}
        return {"file": "net.onnx", "check": "all well", "files": ["README.md"], **ends}

    monkeypatch.setattr(export, "run_task", answer)
    return requests


def test_a_network_goes_to_onnx(asked):
    said = railctl("export", NAME, "--output", "net.onnx").stdout
    assert said == "net.onnx: observation [trains, 391] -> value [trains]\nchecked with onnxruntime: all well\n"
    [(module, request)] = asked
    assert module == "railctl.tools.export.onnx_file"
    assert (request.checkpoint, str(request.output)) == (find_checkpoint(NAME), "net.onnx")


def test_a_checkpoint_goes_to_a_folder_for_flatland(asked):
    said = railctl("export", NAME, "--flatland", "there").stdout
    assert said == "there: 1 file; there/README.md has the commands\n"
    assert asked[0][0] == "railctl.tools.export.flatland_folder"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ([], "give --output FILE.onnx for ONNX, or --flatland FOLDER for flatland-rl's evaluator"),
        (["-o", "a.onnx", "--flatland", "b"], "give --output FILE.onnx for ONNX, or --flatland FOLDER for flat"),
        (["-o", "net.pt"], "--output net.pt: give a file that ends in .onnx, or --flatland for a folder"),
        (["-o", "no/net.onnx"], "--output no/net.onnx: there is no folder no: make it first"),
        (["-o", "old.onnx"], "--output old.onnx: exists already: give another name"),
        (["--flatland", "."], "--flatland .: exists already: give another name"),
    ],
)
def test_wrong_usage_is_one_line(asked, tmp_path, arguments, text):
    (tmp_path / "old.onnx").touch()
    assert complaint(2, "export", NAME, *arguments).startswith(f"railctl: {text}")
    assert asked == []


def test_a_missing_package_is_named_with_its_extra(asked, monkeypatch):
    monkeypatch.setattr(export, "find_spec", lambda name: None if name == "onnxruntime" else object())
    said = complaint(1, "export", NAME, "-o", "net.onnx")
    assert said == "railctl: the package onnxruntime is missing: pip install 'railctl[onnx]'"
