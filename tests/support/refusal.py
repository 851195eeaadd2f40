"""What a known failure says: one line."""

import pytest


def refused(error, function, *arguments, **options) -> str:
    """The text of the error that a call raises."""
    with pytest.raises(error) as caught:
        function(*arguments, **options)
    text = str(caught.value)
    assert text.splitlines() == [text]
    assert len(text) < 900
    return text


def one_line(command, code=1) -> str:
    """The single line that a finished command printed as it failed, but for the faults of its frames."""
    assert command.returncode == code, command.stderr
    (line,) = [line for line in command.stderr.splitlines() if line.strip() and not line.startswith("frame ")]
    return line
