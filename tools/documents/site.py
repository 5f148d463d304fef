"""What mkdocs asks while it makes the site: links from a page to other files of the project are followed, too.

A link to a file outside the documents leads to a copy of it in the site, one to a folder is text, and one to nothing
fails the build, as links between pages do.
"""

import logging
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

LINK = re.compile(r"\[([^\]]+)\]\((\.\./[^)#\s]+)(#[^)\s]*)?\)")
COPIES = "project"  # the folder of the site where such files lie

log = logging.getLogger("mkdocs.hooks.site")  # whose warnings fail a strict build


def on_files(files: Files, config: Any) -> Files:
    """Add the files of the project that pages link to."""
    documents = Path(config.docs_dir)
    for page in list(files.documentation_pages()):
        for _, target, _ in LINK.findall(page.content_string):
            path = documents / target
            place = _place(target)
            if path.is_file() and files.get_file_from_path(place) is None:
                files.append(File.generated(config, place, abs_src_path=str(path.resolve())))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Have links that leave the documents lead to the copies."""
    documents = Path(config.docs_dir)

    def followed(link: re.Match[str]) -> str:
        text, target = link[1], link[2]
        if (documents / target).is_file():
            return f"[{text}]({_place(target)})"
        if not (documents / target).is_dir():
            log.warning("%s links to %s, which is not there", page.file.src_uri, target)
        return text

    assert files is not None  # noqa: S101  (mkdocs names its arguments)
    return LINK.sub(followed, markdown)


def _place(target: str) -> str:
    """Where in the site a file of the project lies; sources get an ending that browsers show."""
    path = target.removeprefix("../")
    shown = Path(path).suffix in {".html", ".png", ".svg", ".csv", ".gif"}
    return f"{COPIES}/{path}" if shown else f"{COPIES}/{path}.txt"
