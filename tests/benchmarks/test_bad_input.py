"""Invalid input: every command in `bad_input.txt` prints the message and exits with the code listed there.

No exception of another package reaches the user, and nothing is integrated or written.
"""

import re
import shlex
from pathlib import Path

import pytest

from support.commands import call

FILES = {
    "syntax.py": "def make(:\n",
    "nomake.py": "x = 1\n",
    "raises.py": "raise RuntimeError('no')\n",
    "makeraises.py": "def make():\n    return 1 / 0\n",
    "wrongtype.py": "problem = 3\n",
    "nostep.py": "def stepp(): pass\n",
    "stepsig.py": "def step(q, p): return q, p\n",
    "stepnone.py": "def step(system, q, p, h): return None\n",
    "stepshape.py": "def step(system, q, p, h): return q[:0], p\n",
    "stepraise.py": "def step(system, q, p, h): raise ValueError('oops')\n",
    "stepnan.py": "def step(system, q, p, h): return q * float('nan'), p\n",
    "stepclaims.py": "CLAIMS = {'ordr': 2}\ndef step(system, q, p, h): return q, p\n",
    "stepreq.py": "REQUIRES = ('sep',)\ndef step(system, q, p, h): return q, p\n",
    "empty.jsonl": "",
    "bad.jsonl": "{not json\n",
    "keyonly.jsonl": '{"id": "x"}\n',
    "scenes.jsonl": '{"cell": "x"}\n',
    "cited/data/short.csv": "a,b\n1,2\n",
    "cited/data/wordless.csv": "",
    "bin.py": "\x00\x01",
}
LINES = Path(__file__).with_name("bad_input.txt").read_text(encoding="utf-8").splitlines()
TABLE = [re.fullmatch(r"(\d )?(.*) => (.*)", line).groups() for line in LINES if line and not line.startswith("#")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with invalid files."""
    made = tmp_path_factory.mktemp("bad")
    (made / "cited" / "data").mkdir(parents=True)
    for name, text in FILES.items():
        (made / name).write_text(text, encoding="utf-8")
    (made / "folder.png").mkdir()
    for name in ("notutf.py", "cited/data/notutf.csv"):
        (made / name).write_bytes(b"\xff\xfe\xfa")
    return made


@pytest.mark.parametrize(("code", "command", "said"), TABLE, ids=[command for _, command, _ in TABLE])
def test_message_and_exit_code_of_invalid_input(code, command, said, folder, monkeypatch):
    monkeypatch.chdir(folder)
    before = sorted(p for p in folder.rglob("*") if "__pycache__" not in p.parts)
    done = call(*shlex.split(command))
    assert done.exit_code == int(code or 2), done.output
    assert said in " ".join((done.stderr + done.stdout).split())
    after = sorted(p for p in folder.rglob("*") if "__pycache__" not in p.parts)
    assert after == before, "something was written"


def test_control_valid_input_is_accepted(folder, monkeypatch):
    monkeypatch.chdir(folder)
    for command in ("integrate pendulum rk4 --h 0.1 --steps 1", "list problems"):
        assert call(*shlex.split(command)).exit_code == 0
    assert len({command for _, command, _ in TABLE}) == len(TABLE)
