"""Hook of mkdocs (mkdocs.yml): the generated pages of the site, and links to files that lie outside
``docs``.

Generated are the reference of the Python interface, from the stubs that list the public names and
the docstrings, the reference of the command line, from the commands, and the pages that a script
of this folder makes from tables of the product. ``mkdocs build --strict`` writes the site to
``build/site``.
"""

from __future__ import annotations

import ast
import re
import runpy
from collections.abc import Iterator
from pathlib import Path

import click

from aeromatch.cli.command import cli
from flightmech.support.imports import public_names

ROOT = Path(__file__).parents[2]
PACKAGES = ("flightmech", "datcom_io", "aerodb", "flighttest", "pom")
OUTSIDE = {
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changes.md",
}  # file of the repository: page of the site
SCRIPTS = {
    "design/folders.md": "make_folders.py",
    "reference/project-keys.md": "make_project_keys.py",
    "reference/column-headings.md": "make_column_headings.py",
    "reference/nomenclature.md": "make_nomenclature.py",
    "reference/row-conditions.md": "make_row_conditions.py",
    "reference/tolerance-rows.md": "make_tolerance_rows.py",
    "reference/terms.md": "make_terms.py",
    "reference/gallery.md": "make_gallery.py",
    "reference/examples.md": "make_examples.py",
}  # page of the site: script whose function page() returns it


def on_files(files, config):
    """Add the generated pages."""
    from mkdocs.structure.files import File

    for source, page in OUTSIDE.items():
        text = (ROOT / source).read_text(encoding="utf-8").replace("](docs/", "](")
        files.append(File.generated(config, page, content=text))
    made = {**python_pages(), "reference/verbs.md": verbs(), **script_pages()}
    for page, text in made.items():
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown, page, config, files):
    """Add the sections of the README to the first page; let links to the files of the repository
    that have a page lead to that page.
    """
    if page.file.src_uri == "index.md":
        markdown = with_readme(markdown)
    for source, target in OUTSIDE.items():
        up = "../" * page.file.src_uri.count("/")
        markdown = re.sub(rf"\]\((?:\.\./)+{re.escape(source)}", f"]({up}{target}", markdown)
    return markdown


def with_readme(markdown: str) -> str:
    """Return a page with the sections of the README that its comments name, each text once."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8").replace("](docs/", "](")
    sections = {}
    for heading, text in re.findall(r"^##? (.+)\n((?:(?!## ).*\n)*)", readme, re.M):
        sections[heading] = text if heading == "aeromatch" else f"## {heading}\n{text}"
    return re.sub(r"<!-- README: (.+) -->\n", lambda match: sections[match[1]], markdown)


def script_pages() -> dict[str, str]:
    """Return the pages that the scripts of this folder make."""
    folder = Path(__file__).parent
    return {page: runpy.run_path(str(folder / name))["page"]() for page, name in SCRIPTS.items()}


def python_pages() -> dict[str, str]:
    """Return a page for every namespace of public names, and one that lists them."""
    pages, listed = {}, []
    for package in PACKAGES:
        for stub in sorted(
            (ROOT / package).rglob("__init__.pyi"), key=lambda file: file.parent.parts
        ):
            name = ".".join(stub.parent.relative_to(ROOT).parts)
            former = former_names(stub)
            own = {
                key: defined(name, key)
                for key, (_, is_module) in public_names(stub).items()
                if not is_module and key not in former
            }
            page = f"reference/{name}.md"
            pages[page] = namespace_page(name, stub, own, top=name == package)
            listed.append(f"| [`{name}`]({name}.md) | {summary(stub.parent)} |")
    pages["reference/python.md"] = (
        "# Python interface\n\nOne page per namespace; the packages themselves repeat the "
        "names that are needed first.\n\n"
        "| namespace | holds |\n| --- | --- |\n" + "\n".join(listed) + "\n"
    )
    return pages


def namespace_page(name: str, stub: Path, own: dict[str, str], top: bool) -> str:
    """Return the page of one namespace: every public name with its docstring, or, for a package,
    where each is described.
    """
    lines = [f"# {name}", "", summary(stub.parent), ""]
    for key, home in sorted(own.items(), key=lambda item: (item[0].lower(), item[0])):
        if top and home.rpartition(".")[0] != name and documented_elsewhere(home):
            lines.append(f"- [`{name}.{key}`][{home}]")
        else:
            lines += [
                "",
                f"::: {home}",
                "    options:",
                f'      heading: "{key}"',
                "      heading_level: 2",
            ]
    return "\n".join(lines) + "\n"


def former_names(stub: Path) -> set[str]:
    """Return the names of a stub that stand for something which has another name now."""
    imports = [
        node for node in ast.parse(stub.read_text()).body if isinstance(node, ast.ImportFrom)
    ]
    names = set()
    for node in imports:
        names.update(item.asname for item in node.names if item.asname not in (None, item.name))
    return names


def documented_elsewhere(home: str) -> bool:
    """Return whether a name is public in a namespace below the package."""
    parts = home.split(".")
    return any(
        (ROOT.joinpath(*parts[:depth]) / "__init__.pyi").is_file()
        and parts[-1] in public_names(ROOT.joinpath(*parts[:depth]) / "__init__.pyi")
        for depth in range(2, len(parts))
    )


def defined(package: str, name: str) -> str:
    """Return the full name of what a public name stands for, where it is defined."""
    module, is_module = public_names(ROOT.joinpath(*package.split(".")) / "__init__.pyi")[name]
    home = f"{package}.{module}"
    if is_module:
        return home
    if (ROOT.joinpath(*home.split(".")) / "__init__.pyi").is_file():
        return defined(home, name)
    return f"{home}.{name}"


def summary(folder: Path) -> str:
    """Return the first line of a folder's docstring."""
    return (
        ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    ).splitlines()[0]


def verbs() -> str:
    """Return the page of all commands with their arguments and options."""
    lines = [
        "# Command line: every verb",
        "",
        "Generated from the commands; `aeromatch GROUP VERB --help` prints the same.",
        "",
    ]
    for words, command in commands(cli, ["aeromatch"]):
        context = click.Context(command, info_name=" ".join(words))
        lines += [f"{'#' * min(len(words), 4)} {' '.join(words)}", ""]
        lines += [
            " ".join(paragraph.split()) + "\n" for paragraph in (command.help or "").split("\n\n")
        ]
        if isinstance(command, click.Group):
            continue
        lines += [
            "```text",
            f"{' '.join(words)} {' '.join(command.collect_usage_pieces(context))}",
            "```",
            "",
        ]
        rows = [
            record
            for option in command.params
            if isinstance(option, click.Option) and (record := option.get_help_record(context))
        ]
        if rows:
            lines += ["| option | |", "| --- | --- |"]
            lines += [f"| `{' '.join(name.split())}` | {cell(text)} |" for name, text in rows] + [
                ""
            ]
    return "\n".join(lines)


def commands(command: click.Command, words: list[str]) -> Iterator[tuple[list[str], click.Command]]:
    """Yield all commands below one, each with its words, groups before their members."""
    if words[1:]:
        yield words, command
    if isinstance(command, click.Group):
        with click.Context(command) as context:
            members = {
                name: command.get_command(context, name) for name in command.list_commands(context)
            }
        for name, member in members.items():
            if member is not None:
                yield from commands(member, [*words, name])


def cell(text: str) -> str:
    """Return text for a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|").replace("[", "&#91;")
