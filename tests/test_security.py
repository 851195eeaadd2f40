"""SECURITY.md keeps its word: every claim names a place and a test, and both are there."""

import ast
import re
from pathlib import Path

import pytest
from reliability.parts import PARTS

ROOT = Path(__file__).parents[1]
CLAIMS = [
    [cell.strip() for cell in line.strip("| ").split(" | ")]
    for line in (ROOT / "SECURITY.md").read_text().split("## Claims")[1].split("\n## ")[0].splitlines()
    if line.startswith("| ") and not line.startswith(("| claim", "| ---"))
]


@pytest.fixture(scope="module")
def tests():
    """The names of all test functions."""
    trees = [ast.parse(file.read_text()) for file in (ROOT / "tests").rglob("test_*.py")]
    functions = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return {function.name for function in functions if function.name.startswith("test_")}


def test_there_are_claims():
    assert len(CLAIMS) >= 13
    assert all(len(claim) == 3 for claim in CLAIMS)


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim[0][:40])
def test_every_claim_names_code_and_a_test_that_exist(claim, tests):
    _, where, proof = claim
    files = [word for word in re.findall(r"`([^`]+)`", where) if word.endswith(".py")]
    assert files
    assert [file for file in files if not (ROOT / file).is_file()] == []
    named = re.findall(r"`([^`]+)`", proof)
    assert any(word.startswith(("test_", "tests/")) for word in named)
    for word in named:
        if word.startswith("tests/"):
            assert (ROOT / word).exists(), word
        elif word.startswith("make reliability PARTS="):
            assert word.partition("=")[2] in PARTS
        else:
            assert word in tests, f"no test {word}"
