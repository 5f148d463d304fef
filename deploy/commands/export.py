"""railctl export: a checkpoint for other programs, as a file of ONNX or a folder for flatland-rl's own evaluator."""

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

from railctl.common.requests import ExportRequest
from railctl.common.strict import ConfigError
from railctl.deploy.output import AsJson, check_free, counted, one_line_errors, say
from railctl.deploy.runs import Failed, find_checkpoint
from railctl.deploy.task import run_task

ONNX_WRITER, FLATLAND_WRITER = "railctl.tools.export.onnx_file", "railctl.tools.export.flatland_folder"
ONNX_NEEDS = ("onnx", "onnxruntime")


@one_line_errors
def export(
    checkpoint: Annotated[
        str,
        typer.Argument(
            metavar="RUN|CHECKPOINT",
            help="A run: its newest checkpoint; a .safetensors file; or one that ships (pretrained/dispatch-hard).",
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write its network as this .onnx file.")
    ] = None,
    flatland: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Make this folder, with all that flatland-rl's own evaluator needs to run it."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a checkpoint for other programs: its network as ONNX, or a folder for flatland-rl's evaluator.

    Give --output or --flatland. What is there already is not overwritten.
    """
    if (output is None) == (flatland is None):
        raise ConfigError("give --output FILE.onnx for ONNX, or --flatland FOLDER for flatland-rl's evaluator")
    result = _to_onnx(checkpoint, output) if output is not None else _to_flatland(checkpoint, Path(flatland or ""))
    say(result.pop("text"), result, as_json=as_json)


def _to_onnx(name: str, output: Path) -> dict[str, Any]:
    if output.suffix != ".onnx":
        raise ConfigError(f"--output {output}: give a file that ends in .onnx, or --flatland for a folder")
    check_free(output, f"--output {output}")
    for package in ONNX_NEEDS:
        if find_spec(package) is None:
            raise Failed(f"the package {package} is missing: pip install 'railctl[onnx]'")
    result = _written(ONNX_WRITER, name, output)
    takes, gives = (_told(result[ends]) for ends in ("inputs", "outputs"))
    return result | {"text": f"{result['file']}: {takes} -> {gives}\nchecked with onnxruntime: {result['check']}"}


def _to_flatland(name: str, folder: Path) -> dict[str, Any]:
    check_free(folder, f"--flatland {folder}")
    result = _written(FLATLAND_WRITER, name, folder)
    text = f"{folder}: {counted(len(result['files']), 'file')}; {folder / 'README.md'} has the commands"
    return result | {"text": text}


def _written(module: str, name: str, output: Path) -> dict[str, Any]:
    request = ExportRequest(checkpoint=find_checkpoint(name), output=output)
    return run_task(module, request.model_dump_json())


def _told(ends: dict[str, list[int]]) -> str:
    """Names and shapes.

    >>> _told({"observation": [252], "state": [64]})
    'observation [trains, 252], state [trains, 64]'
    """
    return ", ".join(f"{name} [{', '.join(['trains', *map(str, shape)])}]" for name, shape in ends.items())
