"""What MJCF has here and older MuJoCo has not, from each one's own schema: `python tests/export/make_newer.py 3.11=PYTHON 3.17=PYTHON`.

PYTHON is the interpreter of a virtual environment with that version of the package `mujoco`.
"""  # noqa: E501

import ctypes
import json
import subprocess
import sys
from pathlib import Path

FILE = Path(__file__).parents[2] / "tiago_mj" / "export" / "newer.json"


def schema():
    """Attributes by "parent/element" of the MuJoCo that this interpreter has."""
    import mujoco

    folder = Path(mujoco.__file__).parent
    library = ctypes.CDLL(str(next(iter(sorted(folder.glob("libmujoco.so*"))))))
    text = ctypes.create_string_buffer(4_000_000)
    library.mj_printSchema(None, text, len(text), 0, 0)
    out, path, within = {}, [], None
    for line in text.value.decode().splitlines():
        words, indent = line.split(), len(line) - len(line.lstrip())
        if len(words) > 1 and words[1] in ("(!)", "(*)", "(?)", "(R)"):
            path = [*path[: indent // 3], words[0]]
            within = "/".join(path[-2:])
            out.setdefault(within, set()).update(words[2:])
        elif within:
            out[within].update(words)
    return {key: sorted(values) for key, values in out.items()}


def newer(own, old):
    """Elements, and elements@attributes, that a schema has and an older one has not."""
    out = [key for key in own if key not in old]
    out += [f"{key}@{name}" for key in own if key in old for name in own[key] if name not in old[key]]
    return sorted(out)


if __name__ == "__main__":
    if not sys.argv[1:]:
        print(json.dumps(schema()))
    else:
        found = {}
        for said in sys.argv[1:]:
            version, _, python = said.partition("=")
            done = subprocess.run([python, __file__], capture_output=True, text=True, check=True)
            found[version] = newer(schema(), json.loads(done.stdout))
        FILE.write_text(json.dumps(found, indent=1) + "\n")
