"""What an installation puts where: one name, `lumpwatch`, and the numerics without the service's packages."""

from __future__ import annotations

import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
SERVICE_ONLY = ("av", "docker", "zenoh", "prometheus_client", "pydantic", "rich", "ruamel", "matplotlib")

BLOCK = f"""
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {SERVICE_ONLY!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Blocked())
"""


def run(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=120
    )


def test_every_package_is_listed() -> None:
    folders = {
        "lumpwatch." + ".".join(init.parent.relative_to(ROOT).parts)
        for top in ("models", "service")
        for init in (ROOT / top).rglob("__init__.py")
    }
    assert folders == set(PROJECT["tool"]["setuptools"]["packages"])


def test_data_files_are_listed() -> None:
    listed = {
        path.relative_to(ROOT)
        for name, files in PROJECT["tool"]["setuptools"]["package-data"].items()
        for file in files
        for path in (ROOT / name.removeprefix("lumpwatch.").replace(".", "/")).glob(file)
    }
    found = {
        path.relative_to(ROOT)
        for top in ("models", "service")
        for path in (ROOT / top).rglob("*")
        if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts
    }
    found = {path for path in found if path.suffix not in (".nbi", ".nbc", ".pyc")}
    assert found == listed


def test_a_folder_called_models_does_not_get_in_the_way(tmp_path: Path) -> None:
    for name in ("models", "service"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('the wrong one')")
    done = run("import lumpwatch.models.state, lumpwatch.service.errors", tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_numerics_need_no_package_of_the_service(tmp_path: Path) -> None:
    walk = """
import importlib, pkgutil, lumpwatch.models
for module in pkgutil.walk_packages(lumpwatch.models.__path__, "lumpwatch.models."):
    importlib.import_module(module.name)
"""
    done = run(BLOCK + walk, tmp_path)
    assert done.returncode == 0, done.stderr


def test_the_command_says_what_is_missing(tmp_path: Path) -> None:
    code = "from lumpwatch.service.cli import main; sys.exit(main(['check', 'site.yaml']))"
    done = run(BLOCK + code, tmp_path)
    assert done.returncode == 1
    assert "lumpwatch[service]" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_wheel_holds_one_name(tmp_path: Path) -> None:
    build = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--wheel-dir",
        str(tmp_path),
        str(ROOT),
    ]
    subprocess.run(build, check=True, timeout=170)
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names if ".dist-info" not in name} == {"lumpwatch"}
    for needed in ("models/py.typed", "service/py.typed", "service/simulator/demo.prior"):
        assert f"lumpwatch/{needed}" in names
