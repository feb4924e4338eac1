from hypothesis import given
from hypothesis import strategies as st

from motord.emulate.bridge.feed import FeedDecoder, FirmwareReport, input_frame

CLOCKS = st.integers(0, 2**32 - 1)


def report_frame(report):
    """Write what the firmware writes (feed_write in feed.c), in another way."""
    bits = f"{0:02b}{report.line_closed:b}{report.t_us:032b}"
    sevens = [int(bits[place : place + 7], 2) for place in range(0, 35, 7)]
    sevens[0] |= 0x80
    return bytes((*sevens, (sum(sevens) + 0x35) % 128))


@given(st.lists(st.builds(FirmwareReport, st.booleans(), CLOCKS)), st.integers(1, 9))
def test_firmware_reports_are_read_however_they_are_cut(reports, chunk):
    data = b"".join(map(report_frame, reports))
    decoder, got = FeedDecoder(), []
    for place in range(0, len(data), chunk):
        got += decoder.feed(data[place : place + chunk])
    assert got == reports


@given(st.binary(), st.builds(FirmwareReport, st.booleans(), CLOCKS))
def test_it_is_in_step_again_after_any_noise(noise, report):
    decoder = FeedDecoder()
    decoder.feed(noise)
    assert decoder.feed(report_frame(report))[-1:] == [report]


def test_corrupt_and_cut_frames_are_left_out():
    good = report_frame(FirmwareReport(True, 123_456))
    bad = bytes((*good[:-1], good[-1] ^ 1))
    assert FeedDecoder().feed(bad + good[:3] + good) == [FirmwareReport(True, 123_456)]
    assert FeedDecoder().feed(good[1:]) == []


@given(st.integers(0, 4095), st.integers(-32768, 32767))
def test_values_for_the_firmware(gray, torque):
    frame = input_frame(gray, torque)
    assert [byte >> 7 for byte in frame] == [1, 0, 0, 0, 0]
    word = int("".join(f"{byte & 127:07b}" for byte in frame[:-1]), 2)
    assert (word >> 16, (word & 0xFFFF) - 32768) == (gray, torque)
    assert frame[-1] == (sum(frame[:-1]) + 0x35) % 128


def test_torque_beyond_the_adc_stays_at_its_end():
    assert input_frame(0, 40_000) == input_frame(0, 32_767)
    assert input_frame(0, -40_000) == input_frame(0, -32_768)
