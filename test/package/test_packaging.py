"""What is said of the package is valid, and a release is refused while it disagrees."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from rigs.paths import ROOT


def test_package_xml_is_valid_for_an_ament_python_package() -> None:
    warnings: list[str] = []
    manifest = _manifest()
    manifest.validate(warnings=warnings)
    assert not warnings
    assert manifest.package_format == 3
    assert manifest.get_build_type() == "ament_python"
    assert (ROOT / manifest.licenses[0].file).read_text().strip().startswith("Apache License")


def _manifest() -> Any:
    return pytest.importorskip("catkin_pkg.package").parse_package(str(ROOT))


@pytest.mark.parametrize(
    ("heading", "change", "says"),
    [
        ("Forthcoming", "", "says Forthcoming; write '1.2.0 ("),
        ("1.1.0 (2026-01-02)", "", "version 1.2.0, but CHANGELOG.rst begins with '1.1.0 ("),
        ("1.2.0 (soon)", "", "but CHANGELOG.rst begins with '1.2.0 (soon)'"),
        ("1.2.0 (2026-01-02)", "echo >more", "changes that are not committed"),
        ("1.2.0 (2026-01-02)", "git tag 1.2.0", "there is a tag 1.2.0 already"),
        ("1.2.0 (2026-01-02)", "", "all checks ran and failed"),
    ],
)
def test_a_release_is_refused_unless_version_changelog_and_checks_agree(
    tmp_path: Path, heading: str, change: str, says: str
) -> None:
    for folder in ("scripts", ".ci"):
        (tmp_path / folder).mkdir()
    shutil.copy(ROOT / "scripts" / "release", tmp_path / "scripts")
    (tmp_path / ".ci" / "run").write_text("#!/bin/sh\necho all checks ran and failed >&2\nexit 1\n")
    (tmp_path / ".ci" / "run").chmod(0o755)
    (tmp_path / "package.xml").write_text("<package>\n  <version>1.2.0</version>\n</package>\n")
    (tmp_path / "CHANGELOG.rst").write_text(f"Changes\n=======\n\n{heading}\n-------\n* x\n")
    commit = "git -c user.name=a -c user.email=b commit -qm x"
    prepare = f"git init -q && git add -A && {commit} && {change or 'true'}"
    subprocess.run(["sh", "-c", prepare], cwd=tmp_path, check=True)
    done = subprocess.run(
        [tmp_path / "scripts" / "release"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert says in done.stderr
