"""The rooms of the repository are the packages of `zerobeam`: setuptools cannot say so in pyproject.toml."""

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

ELSEWHERE = ["tests*", "benchmarks*", "docs*", "build*"]


class WithoutThisFile(build_py):
    """The root is a package, but this file is not a module of it."""

    def find_package_modules(self, package, package_dir):
        return [
            module for module in super().find_package_modules(package, package_dir) if module[1] != "setup"
        ]


setup(
    packages=["zerobeam", *(f"zerobeam.{room}" for room in find_packages(exclude=ELSEWHERE))],
    cmdclass={"build_py": WithoutThisFile},
)
