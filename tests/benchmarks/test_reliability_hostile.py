"""A few inputs of each part: names and clock hold, and a reader that errs is found."""

import pytest
from reliability import clock, names

from edgemap.runtime.inputs.cameras import delivery


@pytest.mark.parametrize("part", [names, clock], ids=lambda part: part.__name__.rpartition(".")[2])
def test_a_few_inputs_fail_nowhere(tmp_path, part):
    report = part.run(7, 0.001, tmp_path)
    assert report.failures == ()
    assert report.table


def test_a_clock_that_trusts_its_device_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr(delivery, "clock_jumps", lambda *_: False)
    assert clock.run(7, 0.003, tmp_path).failures
