"""What the wheel holds and asks of a machine."""

import pathlib
import subprocess

import viscera

FOLDER = pathlib.Path(viscera.__file__).parent
# By the beginning of their names: what viscera-simulate needs, and nothing else.
NEEDED = ("libc.", "libm.", "libgcc_s.", "libstdc++.", "ld-linux", "libfmt.", "libyaml-cpp.", "libcrypto.",
          "libhdf5", "libz.", "libcholmod.", "libvtk", "libITK", "libitk", "libgomp.")


def test_only_what_a_simulation_needs_is_linked():
    module, = FOLDER.glob("_viscera*.so")
    listed = subprocess.run(["readelf", "-d", module], check=True, capture_output=True, text=True).stdout
    libraries = [line.split("[")[1].rstrip("]") for line in listed.splitlines() if "(NEEDED)" in line]
    assert libraries
    assert [name for name in libraries if not name.startswith(NEEDED)] == []


def test_the_package_is_small():
    assert sum(file.stat().st_size for file in FOLDER.rglob("*") if file.is_file()) < 60e6


def test_it_is_what_was_installed_and_not_the_folder_of_sources():
    assert "site-packages" in str(FOLDER)
    assert viscera.__version__
