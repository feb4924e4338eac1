"""Parameters are read-only, and who goes on asking for others disturbs no other viewer."""

from typing import Any, cast

from foxglove import Parameter

from motord.foxglove.server import REFUSED_AT_ONCE, ReadOnlyParameters

NOBODY = cast("Any", None)


def test_refusals_that_all_viewers_would_get_are_few() -> None:
    refused = []
    server = ReadOnlyParameters(lambda: refused.append(1), clock_ns=lambda: 0)
    server.values = {"limits.torque_Nm": 5.0}
    wanted = [Parameter("limits.torque_Nm", value=50.0)]
    answers = [server.on_set_parameters(NOBODY, wanted) for _ in range(2000)]
    assert [one.get_value() for one in answers[0]] == [5.0]
    assert len(refused) == sum(map(bool, answers)) == REFUSED_AT_ONCE
    assert [one.get_value() for one in server.on_get_parameters(NOBODY, [])] == [5.0]
