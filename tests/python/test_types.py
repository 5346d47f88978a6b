"""What type checkers are told of the package, against the package and an example."""

import ast
import importlib
import pathlib
import subprocess
import sys

import pytest
import viscera.labels  # which adds to what its modules have

CONFIG = pathlib.Path(__file__).parent / "mypy.ini"
EXAMPLES = sorted((pathlib.Path(__file__).parent / "examples").glob("*.py"))


def run(*command):
    done = subprocess.run([sys.executable, *command], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def public(names):
    return {name for name in names if not name.startswith("_") or name in ("__version__", "__init__")}


@pytest.mark.parametrize("name", ["_viscera", "_preparation", "_report"])
def test_a_stub_names_all_that_its_module_has_and_nothing_else(name):
    module = importlib.import_module(f"viscera.{name}")
    stub = ast.parse((pathlib.Path(viscera.__file__).parent / f"{name}.pyi").read_text(encoding="utf-8"))
    told = {}
    for node in stub.body:
        if isinstance(node, ast.ClassDef):
            told[node.name] = public(part.target.id if isinstance(part, ast.AnnAssign) else part.name
                                     for part in node.body if isinstance(part, (ast.AnnAssign, ast.FunctionDef)))
        elif isinstance(node, (ast.FunctionDef, ast.AnnAssign)):
            told[node.name if isinstance(node, ast.FunctionDef) else node.target.id] = None
    assert set(told) == public(vars(module))
    for kind, members in told.items():
        if members is None or kind == "Error":  # whose members are each error's own
            continue
        has = public(vars(getattr(module, kind)))
        # What only other classes make has no constructor of its own.
        assert members - {"__init__"} == has - {"__init__"}, kind


def test_the_package_and_its_examples_pass_a_strict_check():
    run("-m", "mypy", "--config-file", CONFIG, "-p", "viscera")
    run("-m", "mypy", "--config-file", CONFIG, *EXAMPLES)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(example):
    assert "sag" in run(example)
