"""Promise: what strangers build from agrees with itself: workflows, container file, conda recipe.

None of them can run here; this is what can be seen without running them. A linter reads the
workflows, and mistakes that are put into a copy show that it would see them.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

yaml = pytest.importorskip("yaml")
tomllib = pytest.importorskip("tomllib")

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def linted(folder: Path) -> subprocess.CompletedProcess[str]:
    """What `make lint` says of the workflows of a folder."""
    programs = Path(sys.executable).parent
    if not (programs / "jactionlint").exists():
        pytest.skip("needs jactionlint (extra dev)")
    words = ["--strict-exit", "--no-color", f"--shellcheck={programs / 'shellcheck'}"]
    return subprocess.run(
        [programs / "jactionlint", *words], cwd=folder, text=True, capture_output=True
    )


def test_the_linter_of_workflows_has_nothing_to_say():
    said = linted(ROOT)
    assert said.returncode == 0, said.stdout + said.stderr


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("needs: [linux, macos, windows, sdist]", "needs: [linux, macos, windows, wheel]"),
        ("${{ matrix.target }}", "${{ matrix.tarket }}"),
        ("runs-on: windows-latest", "runs_on: windows-latest"),
        ("fresh/bin/pip install dist/*.tar.gz", "if [ -e dist ] fi"),
        ("evaluate lqr --seeds 5", "evaluate ${{ github.event.head_commit.message }}"),
    ],
)
def test_the_linter_of_workflows_sees_a_mistake(tmp_path, right, wrong):
    shutil.copytree(ROOT / ".github", tmp_path / ".github")
    (tmp_path / ".git").mkdir()
    path = tmp_path / ".github" / "workflows" / "wheels.yml"
    text = path.read_text(encoding="utf-8")
    assert right in text
    path.write_text(text.replace(right, wrong), encoding="utf-8")
    said = linted(tmp_path)
    assert said.returncode == 1 and "wheels.yml" in said.stdout, said.stdout + said.stderr


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_names_jobs_scripts_and_versions_that_are_there(path):
    workflow = yaml.safe_load(path.read_text(encoding="utf-8"))
    jobs = workflow["jobs"]
    assert workflow["permissions"] == {"contents": "read"}, "more than that is asked for by a job"
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for name, job in jobs.items():
        assert {*job.get("needs", [])} <= set(jobs), name
        assert job.get("timeout-minutes"), f"{name} may run for ever"
        for step in job["steps"]:
            assert ("uses" in step) != ("run" in step), step
            if "uses" in step:
                assert re.fullmatch(r"[\w-]+/[\w-]+@(v\d+|release/v\d+)", step["uses"])
            if step.get("uses", "").startswith("actions/checkout@"):
                assert step["with"]["persist-credentials"] is False
            for target in re.findall(r"\bmake ([a-z-]+)", step.get("run", "")):
                assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
            for script in re.findall(r"\bbash (\S+)", step.get("run", "")):
                assert (ROOT / script).is_file(), script


def test_only_the_release_may_publish():
    jobs = yaml.safe_load((WORKFLOWS[-1]).read_text(encoding="utf-8"))["jobs"]
    assert {name for name, job in jobs.items() if "permissions" in job} == {"release"}
    assert jobs["release"]["if"] == "startsWith(github.ref, 'refs/tags/v')"
    assert set(jobs["release"]["needs"]) == set(jobs) - {"release"}
    uploaded = [
        step["with"]["name"]
        for name, job in jobs.items()
        for step in job["steps"]
        if "upload-artifact" in step.get("uses", "")
    ]
    assert len(uploaded) == len(jobs) - 1 and all(n.startswith("wheels-") for n in uploaded)


def test_the_container_builds_and_starts_a_program_that_takes_its_options():
    text = (ROOT / "docs" / "deploy" / "Containerfile").read_text(encoding="utf-8")
    lines = re.sub(r"\\\n\s*", " ", re.sub(r"^#.*\n", "", text, flags=re.MULTILINE)).splitlines()
    words = [line.split(maxsplit=1) for line in lines if line]
    stages = [rest for word, rest in words if word == "FROM"]
    assert all(re.match(r"docker\.io/library/\w+:\S+", stage) for stage in stages)
    (built,) = re.findall(r"cargo build (.*)", text)
    assert "--locked" in built and "-p rodgym-server --features zmq" in built
    manifest = tomllib.loads((ROOT / "env-server" / "Cargo.toml").read_text(encoding="utf-8"))
    (program,) = manifest["bin"]
    assert manifest["package"]["name"] == "rodgym-server" and "zmq" in manifest["features"]
    stage = stages[0].rpartition(" ")[2]
    assert f"COPY --from={stage} /src/target/release/{program['name']} /usr/local/bin/" in text
    # It does not run as root, and its files are no part of what is copied into the build.
    order = [word for word, _ in words]
    assert order.index("USER") < order.index("ENTRYPOINT")
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    assert {".git", "target", ".venv*", "runs", "dist", "site"} <= set(ignored)
    given = dict(words)
    assert given["ENTRYPOINT"] == f'["{program["name"]}"]'
    usage = (ROOT / "env-server" / "src" / "net" / "help.txt").read_text(encoding="utf-8")
    for option in re.findall(r'"(--[a-z-]+)"', given["CMD"]):
        assert re.search(rf"^ +{option}\b", usage, re.MULTILINE), option
    assert f":{given['EXPOSE']}" in given["CMD"]


def test_a_plain_wheel_holds_the_server_and_the_licences_of_what_is_linked():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["tool"]["maturin"]["features"] == ["server"]
    held = [p for form in project["project"]["license-files"] for p in ROOT.glob(form)]
    texts = {path.name: path.read_text() for path in held}
    assert "Mozilla Public License" in texts["libzmq-MPL-2.0.txt"]
    assert "Frank Denis" in texts["libsodium-ISC.txt"]
    assert {"MIT", "Apache"} <= {word for text in texts.values() for word in re.split(r"\W", text)}


def test_the_crates_that_others_use_can_be_published():
    """All that `cargo publish --dry-run` sees without compiling; `make crates` compiles too."""
    if shutil.which("cargo") is None:
        pytest.skip("needs cargo")
    words = ["package", "--offline", "--no-verify", "--allow-dirty"]
    crates = ["--package", "rodgym-core", "--package", "rodgym-baselines"]
    ran = subprocess.run(["cargo", *words, *crates], cwd=ROOT, text=True, capture_output=True)
    assert ran.returncode == 0, ran.stderr


def test_the_library_of_the_bindings_is_their_extension_s_twin():
    extension, library = (
        tomllib.loads((ROOT / "py-bindings" / name).read_text(encoding="utf-8"))
        for name in ("Cargo.toml", "library/Cargo.toml")
    )
    for part in ("dependencies", "features"):
        assert extension[part] == library[part], part
    assert (ROOT / "py-bindings" / "library" / library["lib"]["path"]).resolve() == (
        ROOT / "py-bindings" / "src" / "lib.rs"
    )


def test_the_conda_recipe_asks_for_what_the_package_needs():
    recipe = yaml.safe_load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text("utf-8"))

    def spaced(requirement: str) -> str:
        return re.sub(r"(?<=\w)(?=[<>=])", " ", requirement, count=1)

    assert recipe["requirements"]["run"] == ["python", *map(spaced, PROJECT["dependencies"])]
    build = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["build-system"]["requires"]
    assert set(map(spaced, build)) <= set(recipe["requirements"]["host"])
    assert recipe["about"]["license"] == PROJECT["license"]
    for name in recipe["about"]["license_file"]:
        # The last is made while the recipe builds.
        assert (ROOT / name).exists() or name in " ".join(recipe["build"]["script"])


def test_a_word_that_must_be_replaced_is_named_at_the_top_and_in_the_list():
    packaging = ROOT / "packaging"
    listed = (packaging / "README.md").read_text(encoding="utf-8")
    for name in ("conda/recipe.yaml", "gymnasium/third_party.md"):
        lines = (packaging / name).read_text(encoding="utf-8").splitlines()
        (row,) = [line for line in listed.splitlines() if f"`{name}`" in line]
        top = "\n".join(line for line in lines[:8] if line.startswith(("#", "<!--")))
        rest = "\n".join(line for line in lines if not line.startswith(("#", "<!--")))
        for word in ("ARCHIVE", "CHECKSUM", "REPOSITORY", "MAINTAINER"):
            used = re.search(rf"\b{word}\b", rest) is not None
            assert used == (f"`{word}`" in row) == (word in top), f"{name}: {word}"
