"""Writes the Markdown of the documentation site.

    generate.py BIN PAGES [SITE]

BIN is the folder of the built programs, PAGES the folder to write, SITE that of the pages written by
hand (this one). Stages, parameters, outputs and gates are those that the programs print; an effect's
parameters are those of its header, held against those that viscera-simulate takes. The project's
documents are copied to PAGES/project. Ends with 1 and a message where an effect has no page, a page no
effect, a page lacks a section, or a test that it names is not there.
"""
import ast
import html
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
DOCUMENTS = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "LICENSE"]
FOLDERS = ["docs", "configs"]
SECTIONS = ["## Equation", "## Source", "## Check", "## Example"]
MATERIALS = "materials: {liver: {E: 5 kPa, nu: 0.45, density: 1060 kg/m3, damping: 20 ms}}\n"


def refuse(message):
    sys.exit(f"docs: {message}")


def output_of(*command, code=0):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode != code:
        refuse(f"{' '.join(map(str, command))} ended with {done.returncode}, not {code}:\n{done.stderr}")
    return done.stderr if code else done.stdout


def read(path):
    return (ROOT / path).read_text(encoding="utf-8")


def cell(value):
    return html.escape(str(value), quote=False).replace("|", "\\|").replace("\n", " ")


def code(value):
    return f"`{value}`".replace("|", "\\|") if str(value) else ""


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows]) + "\n"


# --- documents of the project, and sections of them in pages of the site


def section(document, heading):
    """What stands under a heading; without one, what stands before the first of the second level."""
    text = read(document)
    if not heading:
        return re.split(r"^## ", text, flags=re.M)[0].split("\n", 1)[1]
    found = re.search(rf"^(#+) {re.escape(heading)}\n(.*?)(?=^#{{1,3}} |\Z)", text, re.M | re.S)
    if not found:
        refuse(f"{document} has no section '{heading}'")
    return found[2]


def relinked(text, prefix):
    """Relative links of a document at the root, as a page elsewhere writes them."""
    return re.sub(r"\]\((?![a-z]+:|#)", f"]({prefix}", text)


def indented(text):
    """Code in a list item, which the site's Markdown wants two blanks further in, with a line after it."""
    return re.sub(r"(?<=\n\n)((?: {6,}.*\n)+)",
                  lambda block: re.sub(r"^", "  ", block[1].rstrip("\n"), flags=re.M) + "\n\n", text)


def filled(text):
    """{{README.md}}, {{README.md: Heading}} and {{configs/demo.yaml}} replaced by what they name."""

    def part(match):
        document, _, heading = match[1].partition(": ")
        if document.endswith(".md"):
            return indented(relinked(section(document, heading), "project/")).strip("\n")
        return read(document).strip()

    return re.sub(r"\{\{(.+?)\}\}", part, text)


def copy_documents(pages):
    """The documents with the folders between them, so that their links hold; folders get a list."""
    for document in DOCUMENTS:
        (pages / "project").mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / document, pages / "project" / document)
    for folder in FOLDERS:
        shutil.copytree(ROOT / folder, pages / "project" / folder,
                        ignore=lambda at, _: ["site"] if pathlib.Path(at) == ROOT / "docs" else [])
    for page in sorted((pages / "project").rglob("*.md")):
        def list_folder(match, page=page):
            target = page.parent / match[1]
            if not target.is_dir():
                return match[0]
            if (target / "README.md").exists():
                return f"]({match[1]}/README.md)"
            names = sorted(p.relative_to(target).as_posix() for p in target.rglob("*") if p.is_file())
            listed = "\n".join(f"- [{name}]({name})" for name in names if name != "index.md")
            (target / "index.md").write_text(f"# {match[1]}\n\n{listed}\n", encoding="utf-8")
            return f"]({match[1]}/index.md)"

        text = indented(page.read_text(encoding="utf-8"))
        page.write_text(re.sub(r"\]\(([^):#]+)\)", list_folder, text), encoding="utf-8")


# --- stages


def number(value):
    """As short as it can be said: 1000000.0 is 1e6."""
    return re.sub(r"e([+-])0*", lambda sign: "e" + sign[1].strip("+"), f"{float(value):g}")


def kind_of(param):
    return f"{param['type']}, {param['unit']}" if param.get("unit", "1") != "1" else param["type"]


def allowed(param):
    if "choices" in param:
        return ", ".join(code(choice) for choice in param["choices"])
    low, high = param.get("min"), param.get("max")
    unit = f" {param['unit']}" if param.get("unit", "1") != "1" else ""
    if low is None and high is None:
        return ""
    if high is None:
        return f"at least {number(low)}{unit}"
    return f"{number(low)} to {number(high)}{unit}"


def default(param):
    value = param["default"]
    if value is None:
        return "unset"
    return code(value if isinstance(value, str) else json.dumps(value))


def gate_rows(gates):
    """A gate that judges from both sides is one row."""
    sides = {"<=": "at most", ">=": "at least"}
    rows = {}
    for gate in gates:
        key = (gate["name"], gate["unit"], gate["meaning"], gate["remedy"])
        rows.setdefault(key, []).append(sides[gate["comparison"]])
    return [[code(name), " or ".join(sorted(bounds)), cell(unit), cell(meaning), cell(remedy)]
            for (name, unit, meaning, remedy), bounds in rows.items()]


def stage_page(stage):
    name = stage["stage"]
    inputs = [[code(i["role"]), "required" if i["required"] else "optional",
               "several" if i["many"] else "one", cell(i["doc"])] for i in stage["inputs"]]
    outputs = [[code(o["file"]), code(o["role"]), cell(o["doc"])] for o in stage["outputs"]]
    params = [[code(p["name"]), kind_of(p), default(p), allowed(p), "yes" if p["in_key"] else "no",
               cell(p["doc"])] for p in stage["params"]]
    text = [f"# {name}\n\n{stage['doc'].rstrip('.')}. The program is `viscera-{name}`, version "
            f"{stage['version']}; `viscera-{name} describe` prints what this page shows.\n",
            "## Inputs\n", table(["role", "needed", "files", "what it is"], inputs),
            "## Outputs\n", table(["file", "role", "what it is"], outputs),
            "## Parameters\n", "A unit that is not given is 1. A parameter that is not in the cache key "
            "does not change the result.\n",
            table(["name", "type, unit", "default", "allowed", "in the cache key", "what it does"], params),
            "## Gates\n"]
    if stage["gates"]:
        text.append(table(["gate", "bound", "unit", "what a failure means", "what to change"],
                          gate_rows(stage["gates"])))
    else:
        text.append("This stage has none.\n")
    return "\n".join(text)


# --- effects

# Name, unit (of a word: its choices), bounds (of numbers) and what it is.
FIELD = re.compile(r'Field\{\s*"(\w+)",\s*"([^"]*)",\s*&\w+::\w+,\s*'
                   r'(?:([^",]+),\s*([^",]+),\s*)?((?:"[^"]*"\s*)+)\}')
SHARED = ["sim/effects/contact.hpp", "sim/model/selection.hpp", "sim/effects/colliders.hpp"]


def block_of(text, name):
    """From the struct of an effect, or of the parameters before it, to the next name in its file."""
    at = text.find(f'name = "{name}"')
    start = text.rfind("\nstruct ", 0, at)
    own = re.match(r"\nstruct (\w+)", text[start:])[1]
    params = text.rfind(f"\nstruct {own}Params ", 0, start)
    start = params if params >= 0 else start
    after = text.find("static constexpr const char* name", at)
    return text[start:after if after >= 0 else len(text)]


def fields_in(text):
    fields = {}
    for name, unit, low, high, doc in FIELD.findall(text):
        member = re.search(rf"^ +(double|Vec3<double>|std::string) (?:\w+, )*{name}"
                           r"(?: = ([^;]+))?(?:, \w+)*;", text, re.M)
        fields[name] = {"unit": unit, "low": low, "high": high, "vector": member[1] == "Vec3<double>",
                        "default": member[2], "doc": "".join(re.findall(r'"([^"]*)"', doc))}
    return fields


def comment(text):
    """The paragraphs of a comment, without its marks."""
    lines = re.match(r"(?://.*\n)+", text)
    return re.sub(r"^// ?", "", lines[0], flags=re.M).rstrip() if lines else ""


def effects_of(binary, folder):
    """The effects that viscera-simulate takes, and the parameters of each, in its order."""

    def keys(effects):
        scene = folder / "scene.yaml"
        scene.write_text(f"scene: 1\n{MATERIALS}effects: {effects}\n", encoding="utf-8")
        said = output_of(binary / "viscera-simulate", "check", "--in", f"mesh={scene}", "--in",
                         f"scene={scene}", code=3)
        listed = re.search(r"use one of: (.*)", said)
        if not listed:
            refuse(f"viscera-simulate did not list what it takes in effects: {effects}\n{said}")
        return [name for name in listed[1].strip().split(", ") if name]

    return {name: keys(f"{{{name}: {{no_such_key: 1}}}}") for name in keys("{no_such_effect: 1}")}


def parameter_rows(name, names, header, text):
    shared = {}
    for path in SHARED:
        shared.update(fields_in(read(path).split("static constexpr const char* name")[0]))
    fields = shared | fields_in(block_of(text, name))
    rows = []
    for key in names:
        if key not in fields:
            refuse(f"{header} does not declare the parameter {key} of {name} as this script reads it")
        field = fields[key]
        if not field["low"]:  # a word
            may = ", ".join(map(code, field["unit"].split("|"))) if field["unit"] else "any name"
            word = (field["default"] or "").strip('"')
            rows.append([code(key), "text", code(word) or "none", may, cell(field["doc"])])
            continue
        unit = "" if field["unit"] == "1" else f" {field['unit']}"
        given = [v.strip() for v in (field["default"] or "").strip("{}").split(",") if v.strip()]
        low, high, *values = [value if value == "required" else number({"latest": 1e9}.get(value, value))
                              for value in [field["low"], field["high"]] + given]
        if "required" in values:
            shown = "required"
        elif field["vector"]:
            vector = "[" + ", ".join(v + unit for v in values or ["0"] * 3) + "]"
            shown = code(vector) if field["default"] else "none"
        else:
            shown = code(values[0] + unit)
        kind = "3 numbers" if field["vector"] else "number"
        rows.append([code(key), kind + unit.replace(" ", ", ", 1), shown, f"{low} to {high}{unit}",
                     cell(field["doc"])])
    return rows


def effect_page(name, names, page, tests):
    text = page.read_text(encoding="utf-8")
    for heading in SECTIONS:
        if f"\n{heading}\n" not in text:
            refuse(f"{page} has no section '{heading}'")
    check = text.split("\n## Check\n")[1].split("\n## ")[0]
    named = re.findall(r"`([A-Z]\w*\.\w+)`", check)
    if not named:
        refuse(f"{page} names no test under '## Check'")
    for test in named:
        if test not in tests:
            refuse(f"{page} names the test {test}, which is not there")
    header = next(path for path in sorted((ROOT / "sim/effects").rglob("*.hpp"))
                  if f'name = "{name}"' in path.read_text(encoding="utf-8"))
    header = header.relative_to(ROOT).as_posix()
    source = read(header)
    params = parameter_rows(name, names, header, source)
    shown = table(["name", "type, unit", "default", "allowed", "what it does"], params) if params else \
        "It has none of its own.\n"
    struct = source.rfind("struct ", 0, source.find(f'name = "{name}"'))
    above = re.search(r"\n\n((?://.*\n)+)$", source[:struct])
    words = comment(source) + ("\n\n" + comment(above[1]) if above else "")
    return (f"{text.rstrip()}\n\n## Parameters\n\n{shown}\n## In the code\n\n`{header}` says of this "
            f"effect and of what it shares with others in that file:\n\n```text\n{words}\n```\n")


def tests_of_the_project():
    found = set()
    for path in (ROOT / "tests").rglob("*.cpp"):
        for suite, test in re.findall(r"^(?:TYPED_)?TEST(?:_F|_P)?\(\s*(\w+),\s*(\w+)\s*\)",
                                      path.read_text(encoding="utf-8"), re.M):
            found.add(f"{suite}.{test}")
    return found


def write_effects(binary, pages, site):
    with tempfile.TemporaryDirectory() as folder:
        effects = effects_of(binary, pathlib.Path(folder))
    written = {path.stem for path in (site / "effects").glob("*.md")}
    for name in effects:
        if name not in written:
            refuse(f"the effect {name} has no page: write {site / 'effects' / name}.md")
    for name in sorted(written - set(effects)):
        refuse(f"{site / 'effects' / name}.md is the page of no effect: remove it")
    tests = tests_of_the_project()
    nav, rows = [], []
    for name, names in effects.items():
        text = effect_page(name, names, site / "effects" / f"{name}.md", tests)
        (pages / "effects" / f"{name}.md").write_text(text, encoding="utf-8")
        summary = text.split("\n\n")[1].replace("\n", " ").split(". ")[0].rstrip(".")
        rows.append([f"[`{name}`]({name}.md)", summary])
        nav.append({name: f"effects/{name}.md"})
    index = "# Material laws and effects\n\nIn the order in which a substep applies those of one kind. " \
            "An effect that a scene does not name costs nothing.\n\n"
    (pages / "effects/index.md").write_text(index + table(["effect", "what it is"], rows), encoding="utf-8")
    return [{"All": "effects/index.md"}] + nav


# --- the Python package

PACKAGE = "pipeline/python/viscera"
# What its users see, in the order in which they meet it, and where it is told of.
PYTHON = [("labels.py", ["read_labels"]), ("_preparation.pyi", ["Labels", "Surface"]),
          ("_viscera.pyi", ["TetMesh"]), ("__init__.py", ["Simulation"]), ("_viscera.pyi", ["DeviceArray"]), ("torch.py", ["AtRest"]),
          ("bridges.py", ["mesh_to_vtk", "surface_to_vtk", "simulation_to_vtk", "mesh_to_meshio", "mesh_from_meshio",
                           "VtuSeries", "trajectory_to_vtu"]),
          ("studies.py", ["study"]), ("reports.py", ["report", "Report"]),
          ("programs.py", ["run", "estimate", "measured", "Stage", "Failed"]), ("_viscera.pyi", ["Error", "read_mesh"])]


def signature(name, function):
    arguments = [a for a in re.split(r",\s*(?![^\[]*\])", ast.unparse(function.args)) if a not in ("self", "/", "")]
    returns = f" -> {ast.unparse(function.returns)}" if function.returns and name[0].islower() else ""
    return f"{name}({', '.join(arguments)}){returns}"


def told(node):
    """A docstring as it stands, for its examples and columns are text."""
    text = ast.get_docstring(node)
    return f"```text\n{text}\n```\n" if text else ""


def python_entry(node):
    if isinstance(node, ast.FunctionDef):
        return [f"## {node.name}\n", f"```python\n{signature(node.name, node)}\n```\n", told(node)]
    text, rows = [f"## {node.name}\n"], []
    methods = [part for part in node.body if isinstance(part, ast.FunctionDef)
               and (part.name == "__init__" or not part.name.startswith("_"))]
    for part in methods:
        if part.name == "__init__":
            text.append(f"```python\n{signature(node.name, part)}\n```\n")
    text.append(told(node))
    for part in node.body:
        if isinstance(part, ast.AnnAssign):
            rows.append([code(part.target.id), code(ast.unparse(part.annotation))])
    for part in methods:
        if any(ast.unparse(mark) == "property" for mark in part.decorator_list):
            rows.append([code(part.name), code(ast.unparse(part.returns))])
    if rows:
        text.append(table(["has", "type"], rows))
    for part in methods:
        if part.name != "__init__" and not part.decorator_list:
            text += [f"### {node.name}.{part.name}\n", f"```python\n{signature(part.name, part)}\n```\n", told(part)]
    return text


def python_page():
    words = re.sub(r"\]\(([^):#]+)\)", lambda link: f"]({link[1]}/index.md)" if (ROOT / link[1]).is_dir() else link[0],
                   section("README.md", "From Python"))
    text = ["# Python\n", relinked(words, "project/")]
    for file, names in PYTHON:
        nodes = {node.name: node for node in ast.parse(read(f"{PACKAGE}/{file}")).body if hasattr(node, "name")}
        for name in names:
            if name not in nodes:
                refuse(f"{PACKAGE}/{file} has no {name}")
            text += python_entry(nodes[name])
    return "\n".join(text)


def write_gallery(pages):
    """The pages that `make gallery` has made beside these, or how to make them."""
    made = pages.parent / "gallery"
    if not (made / "index.md").is_file():
        (pages / "gallery").mkdir()
        (pages / "gallery/index.md").write_text(
            "# Gallery\n\nEight scenes, each with a picture, its YAML and its cost. They are not made yet: "
            "`make gallery` runs and draws them, and `make docs` then shows them here.\n", encoding="utf-8")
        return [{"All": "gallery/index.md"}]
    shutil.copytree(made, pages / "gallery")
    index = (made / "index.md").read_text(encoding="utf-8")
    return [{"All": "gallery/index.md"}] + [{title: f"gallery/{page}"} for title, page in
                                            re.findall(r"^## \[(.*)\]\((.*)\)$", index, re.M)]


def main(binary, pages, site):
    shutil.rmtree(pages, ignore_errors=True)
    for folder in ["stages", "effects"]:
        (pages / folder).mkdir(parents=True)
    copy_documents(pages)
    shutil.copy(site / "site.css", pages)
    for page in site.glob("*.md"):
        (pages / page.name).write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")

    schema = json.loads(output_of(binary / "viscera", "schema"))
    order = ["labels", "surface", "tetmesh", "simulate", "report", "compare", "cohort"]
    names = sorted(schema["properties"]["stages"]["properties"],
                   key=lambda name: (order.index(name) if name in order else len(order), name))
    stages = [json.loads(output_of(binary / f"viscera-{name}", "describe")) for name in names]
    for stage in stages:
        (pages / "stages" / f"{stage['stage']}.md").write_text(stage_page(stage), encoding="utf-8")
    rows = [[f"[`{s['stage']}`]({s['stage']}.md)", cell(s["doc"]),
             ", ".join(code(i["role"]) for i in s["inputs"]),
             ", ".join(code(o["file"]) for o in s["outputs"])] for s in stages]
    (pages / "stages/index.md").write_text(
        "# Stages\n\n" + table(["stage", "what it does", "reads", "writes"], rows), encoding="utf-8")

    helps = [["viscera", "--help"]] + [["viscera", verb, "--help"] for verb in
             ["run", "estimate", "why", "status", "graph", "gc", "verify", "schema"]]
    programs = "# The program `viscera`\n\nWhat its help says.\n"
    for program, *words in helps:
        programs += f"\n## {' '.join([program] + words[:-1])}\n\n```text\n" \
                    f"{output_of(binary / program, *words).strip()}\n```\n"
    (pages / "programs.md").write_text(programs, encoding="utf-8")
    (pages / "python.md").write_text(python_page(), encoding="utf-8")

    nav = [{"Home": "index.md"}, {"Tutorial": "tutorial.md"},
           {"Stages": [{"All": "stages/index.md"}] + [{n: f"stages/{n}.md"} for n in names]},
           {"The scene": "scene.md"},
           {"Laws and effects": write_effects(binary, pages, site)},
           {"Gallery": write_gallery(pages)},
           {"The program viscera": "programs.md"}, {"Glossary": "glossary.md"},
           {"Extending": "extending.md"}, {"Python": "python.md"}, {"API": "api.md"},
           {"Documents": [{"README": "project/README.md"}, {"Architecture": "project/ARCHITECTURE.md"},
                          {"Contributing": "project/CONTRIBUTING.md"}, {"Changelog": "project/CHANGELOG.md"},
                          {"Claims": "project/docs/claims.md"}, {"Results": "project/docs/results/index.md"}]}]
    config = (site / "mkdocs.yml").read_text(encoding="utf-8")
    config += f"docs_dir: {pages.name}\nnav: {json.dumps(nav)}\n"
    (pages.parent / "mkdocs.yml").write_text(config, encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    os.environ["LC_ALL"] = "C.UTF-8"
    main(pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve(),
         pathlib.Path(sys.argv[3] if len(sys.argv) == 4 else ROOT / "docs/site").resolve())
