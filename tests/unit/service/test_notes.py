"""Notes: a line of text with its time, among the events and in the recording."""

import pytest

from motord.api.errors import RpcError
from motord.api.requests import NOTE, parse
from motord.service.host.events import KEPT
from tests.unit.service.virtual_service import VirtualService


def test_a_note_is_an_event_with_its_time_and_needs_no_lease():
    service = VirtualService()
    answer = service.ask("note", text="  Lager gewechselt – neu ", by="anna")
    event = service.events.recent()[-1]
    assert (event.kind, event.message, event.data) == (
        "note", "Lager gewechselt – neu", {"by": "anna"},
    )  # fmt: skip
    assert answer == {"t_ns": event.t_ns, "recording": ""}
    service.recording_file = "/runs/sim-000.mcap"
    assert service.ask("note", text="x")["recording"] == "/runs/sim-000.mcap"


def test_its_length_is_that_of_the_characters():
    assert len(parse(NOTE, ('{"text": "%s"}' % ("é" * 1000)).encode()).text) == 1000
    with pytest.raises(RpcError, match="text: String should have at most 1000"):
        parse(NOTE, ('{"text": "%s"}' % ("é" * 1001)).encode())


def test_no_more_than_the_newest_events_are_kept():
    service = VirtualService()
    for number in range(KEPT + 1):
        service.ask("note", text=f"note {number}")
    assert len(service.events.recent()) == KEPT
