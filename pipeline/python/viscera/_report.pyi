import os
from collections.abc import Mapping
from typing import Any

def check(params: Mapping[str, Any], /) -> None: ...
def report_in_folder(inputs: Mapping[str, str | os.PathLike[str]], params: Mapping[str, Any],
                     out: str | os.PathLike[str], /) -> None: ...
