"""Completion: bash itself is asked; zsh and fish read their scripts where they are installed."""

from __future__ import annotations

import argparse
import shutil
import subprocess
from pathlib import Path

import pytest

from camnet.cli.completion import script
from camnet.cli.main import build_parser

_ASK = """source {script}
COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); _camnet; printf '%s\\n' "${{COMPREPLY[@]}}"
"""


def completed(tmp_path: Path, words: str) -> set[str]:
    path = tmp_path / "camnet.bash"
    path.write_text(script("bash", build_parser()))
    ask = _ASK.format(script=path, words=words)
    done = subprocess.run(["bash", "-c", ask], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert not done.stderr
    return set(done.stdout.split())


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_bash_completes_commands_options_choices_worlds_and_files(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("")
    assert completed(tmp_path, "camnet si") == {"simulate"}
    assert completed(tmp_path, "camnet simulate --see") == {"--seed", "--seeds"}
    assert completed(tmp_path, "camnet simulate quick") == {"quickstart"}
    assert completed(tmp_path, "camnet simulate mi") == {"mine.yaml"}
    assert completed(tmp_path, "camnet simulate quickstart --log-level de") == {"debug"}
    assert completed(tmp_path, "camnet reproduce adate-n") == {"adate-navigation"}
    assert completed(tmp_path, "camnet simulate --out mi") == {"mine.yaml"}


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_option_of_every_command_is_there_and_the_shell_can_read_it(shell: str, tmp_path: Path) -> None:
    program = build_parser()
    text = script(shell, program)
    (commands,) = [a for a in program._actions if isinstance(a, argparse._SubParsersAction)]
    for name, parser in commands.choices.items():
        assert name in text
        for option in parser._option_string_actions:
            plain = option.lstrip("-")
            assert (f"-l {plain}" if shell == "fish" and option.startswith("--") else plain) in text
    if shutil.which(shell):
        path = tmp_path / "script"
        path.write_text(text)
        assert subprocess.run([shell, "-n", str(path)], check=False).returncode == 0
