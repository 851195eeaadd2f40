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
