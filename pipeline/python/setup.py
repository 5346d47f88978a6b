"""Only says that the wheel holds machine code, which CMake has compiled already (make wheel)."""

from setuptools import Distribution, setup


class WithMachineCode(Distribution):
    def has_ext_modules(self):
        return True


setup(distclass=WithMachineCode)
