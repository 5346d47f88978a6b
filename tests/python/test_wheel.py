"""What the wheel holds and asks of a machine."""

import pathlib
import subprocess

import pytest
import viscera

FOLDER = pathlib.Path(viscera.__file__).parent
# By the beginning of their names: what the programs of the stages need, and nothing else.
BOTH = ("libc.", "libm.", "libgcc_s.", "libstdc++.", "ld-linux", "libfmt.", "libyaml-cpp.", "libcrypto.", "libz.",
        "libvtk", "libITK", "libitk")
NEEDED = {"_viscera": (*BOTH, "libhdf5", "libcholmod.", "libgomp."),
          "_preparation": (*BOTH, "libgmsh.", "libmpfr.", "libgmp.", "libdcm", "liboflog.", "libofstd."),
          "_report": (*BOTH, "libhdf5", "libdcm", "liboflog.", "libofstd.")}


@pytest.mark.parametrize("name", NEEDED)
def test_only_what_the_stages_need_is_linked(name):
    module, = FOLDER.glob(f"{name}.*.so")
    listed = subprocess.run(["readelf", "-d", module], check=True, capture_output=True, text=True).stdout
    libraries = [line.split("[")[1].rstrip("]") for line in listed.splitlines() if "(NEEDED)" in line]
    assert libraries
    assert [library for library in libraries if not library.startswith(NEEDED[name])] == []


def test_the_package_is_small():
    assert sum(file.stat().st_size for file in FOLDER.rglob("*") if file.is_file()) < 60e6


def test_it_is_what_was_installed_and_not_the_folder_of_sources():
    assert "site-packages" in str(FOLDER)
    assert viscera.__version__
