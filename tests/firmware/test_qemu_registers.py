"""What the chip's image writes into the registers that QEMU does not have: they lie in RAM here.

The numbers are those of ST's reference manual RM0090. What the hardware does with them is not
tested: it needs the chip.
"""

import time
from contextlib import contextmanager

import pytest

from motord.wire.bridge import frames, segmentation
from tests.firmware.debugger import Debugger, arguments, pend
from tests.firmware.images import emulated
from tests.firmware.machine import machine
from tests.support.patience import PATIENCE_S

pytestmark = pytest.mark.system

RCC, FLASH = 0x2001_1000, 0x2001_1400
GPIOA, GPIOB, GPIOC = 0x2001_2000, 0x2001_2400, 0x2001_2800
ADC, ADC_CCR, DMA, IWDG, CAN = (
    0x2001_3000, 0x2001_3304, 0x2001_4000, 0x2001_5000, 0x2001_6000
)  # fmt: skip
IRQ_CAN1_RX0 = 20
MODER, AFRL, AFRH, PUPDR, IDR = 0x00, 0x20, 0x24, 0x0C, 0x10
READY = {
    RCC: 1 << 17 | 1 << 25,  # CR: crystal and PLL are ready
    CAN + 0x04: 1,  # MSR: initialising
    CAN + 0x08: 7 << 26,  # TSR: all three mailboxes are empty
}
ENCODER_PINS = (0, 1, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14)
HZ = 1_000_000


@contextmanager
def chip(folder, name="stm32f405_in_qemu"):
    """Run the chip's image; yield the machine and a function that connects a debugger."""
    preset = [
        f"loader,addr={address:#x},data={value:#x},data-len=4" for address, value in READY.items()
    ]
    devices = [word for each in preset for word in ("-device", each)]
    with machine(emulated(name), *devices, *arguments(folder / "gdb")) as board:
        yield board, lambda: Debugger(folder / "gdb")


@pytest.fixture
def started(tmp_path):
    """The chip's image after its start, with a debugger connected: registers can be read."""
    with chip(tmp_path) as (board, debugger):
        board.next(frames.Hello)
        with debugger() as connected:
            yield connected.word


def field(word, low, bits):
    return word >> low & ((1 << bits) - 1)


def test_clocks(started):
    pll = started(RCC + 0x04)
    assert field(pll, 22, 1) == 1  # from the crystal
    pll_Hz = 8 * HZ / field(pll, 0, 6) * field(pll, 6, 9)
    assert pll_Hz / (2 + 2 * field(pll, 16, 2)) == 168 * HZ
    assert pll_Hz / field(pll, 24, 4) == 48 * HZ
    assert HZ <= 8 * HZ / field(pll, 0, 6) <= 2 * HZ
    dividers = started(RCC + 0x08)
    assert (field(dividers, 4, 4), field(dividers, 10, 3), field(dividers, 13, 3)) == (0, 5, 4)
    assert field(dividers, 0, 2) == 2  # PLL
    assert field(started(FLASH), 0, 4) == 5  # wait states at 168 MHz and 3.3 V
    assert started(RCC + 0x30) == 0b111 | 1 << 22  # GPIOA to C, DMA2
    assert started(RCC + 0x40) == 1 << 3  # TIM5
    assert started(RCC + 0x44) == 1 << 4 | 1 << 8  # USART1, ADC1


def test_pins(started):
    a, b, c = (started(port + MODER) for port in (GPIOA, GPIOB, GPIOC))
    assert {pin: field(a, 2 * pin, 2) for pin in range(16) if field(a, 2 * pin, 2)} == {
        1: 3, 9: 2, 10: 2,
    }  # fmt: skip
    assert b == 0
    assert {pin: field(c, 2 * pin, 2) for pin in range(16) if field(c, 2 * pin, 2)} == {
        6: 1, 8: 1, 12: 1,
    }  # fmt: skip
    assert started(GPIOA + AFRH) == 7 << 4 | 7 << 8  # USART1
    pulls = started(GPIOB + PUPDR)
    assert [pin for pin in range(16) if field(pulls, 2 * pin, 2) == 1] == list(ENCODER_PINS)
    assert started(GPIOC + PUPDR) == 2 << 14  # PC7 down


def test_adc_and_its_dma(started):
    assert started(ADC + 0x08) == 1 | 1 << 1 | 1 << 8 | 1 << 9 | 1 << 30
    assert started(ADC + 0x10) == 1 << 3  # channel 1, 15 cycles
    assert (started(ADC + 0x2C), started(ADC + 0x34)) == (0, 1)  # one conversion, channel 1
    assert field(started(ADC_CCR), 16, 2) == 1  # 84 MHz / 4, at most 36
    control = started(DMA + 0x10)
    assert (field(control, 25, 3), field(control, 0, 1), field(control, 6, 2)) == (0, 1, 0)
    assert (field(control, 8, 1), field(control, 10, 1)) == (1, 1)  # circular, counting memory up
    assert (field(control, 11, 2), field(control, 13, 2)) == (1, 1)  # halfwords
    assert started(DMA + 0x14) == 16
    assert started(DMA + 0x18) == ADC + 0x4C


def test_watchdog(started):
    assert (started(IWDG), started(IWDG + 0x04), started(IWDG + 0x08)) == (0xAAAA, 0, 160)


def test_each_encoder_pin_is_its_bit(tmp_path):
    with chip(tmp_path) as (board, debugger):
        board.configure(2000)
        for bit, pin in enumerate(ENCODER_PINS):
            with debugger() as connected:
                connected.write_word(GPIOB + IDR, 1 << pin)
            board.next(frames.Sample, lambda s, bit=bit: s.encoder_gray == 1 << bit)
        with debugger() as connected:
            connected.write_word(GPIOB + IDR, 0xFFFF)
        board.next(frames.Sample, lambda s: s.encoder_gray == 0xFFF)


def sent(word):
    """Return what the transmit mailboxes hold, the oldest first."""
    held = []
    for box in range(3):
        identifier, length, low, high = (word(CAN + 0x180 + 16 * box + 4 * n) for n in range(4))
        data = low.to_bytes(4, "little") + high.to_bytes(4, "little")
        held.append((identifier, data[: length & 0xF]))
    assert {identifier for identifier, _ in held} == {0x190 << 21 | 1}  # and requested to be sent
    return sorted(data for _, data in held)


def receive(connected, data):
    """Put a frame into the receive mailbox."""
    mailbox = CAN + 0x1B0
    for offset, word in (
        (0, 0x110 << 21),
        (4, len(data)),
        (8, int.from_bytes(data[:4], "little")),
        (12, int.from_bytes(data[4:], "little")),
    ):
        connected.write_word(mailbox + offset, word)
    connected.write_word(CAN + 0x0C, 1)  # RF0R: one frame


def last_pieces(hello, sequence, number):
    """Return the last three pieces of a Hello, as the mailboxes hold them in the end."""
    return sorted(segmentation.split(frames.pack(hello, sequence), number)[-3:])


def wait_for_pieces(debugger, pieces):
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        with debugger() as connected:
            if connected.word(CAN + 0x184) and sent(connected.word) == pieces:
                return
            assert time.monotonic() < deadline_s, sent(connected.word)
        time.sleep(0.05)


def test_frames_over_can(tmp_path):
    name = b"stm32f405".ljust(16, b"\0")
    hello = frames.Hello(
        frames.PROTOCOL, frames.firmware(1, 3, 0), name, 0, 1000, 4096, frames.LAYOUT_HASH
    )
    with chip(tmp_path, "stm32f405_can_in_qemu") as (_, debugger):
        wait_for_pieces(debugger, last_pieces(hello, 0, 0))
        [request] = segmentation.split(frames.pack(frames.HelloRequest(frames.PROTOCOL), 0), 0)
        with debugger() as connected:
            receive(connected, request)
        pend(tmp_path / "gdb", IRQ_CAN1_RX0)
        pieces = len(segmentation.split(frames.pack(hello, 0), 0))
        wait_for_pieces(debugger, last_pieces(hello, 1, pieces))


def test_the_can_controller(tmp_path):
    with chip(tmp_path, "stm32f405_can_in_qemu") as (_, debugger):
        sends = 0
        while not sends:
            with debugger() as connected:
                sends = connected.word(CAN + 0x184)
                if sends:
                    check_bus(connected.word)
            time.sleep(0.02)


def check_bus(word):
    """Look at the bit timing, the filter and the interrupts."""
    timing = word(CAN + 0x1C)
    prescaler, first, second = (
        field(timing, 0, 10) + 1, field(timing, 16, 4) + 1, field(timing, 20, 3) + 1
    )  # fmt: skip
    assert 42 * HZ / prescaler / (1 + first + second) == HZ
    assert 0.8 < (1 + first) / (1 + first + second) < 0.9
    assert field(timing, 24, 2) + 1 <= second
    assert field(timing, 30, 2) == 0  # neither silent nor looped back
    assert word(CAN) == 1 << 2 | 1 << 6  # on the bus; in order; back after bus-off
    assert word(CAN + 0x14) == 0b11  # interrupts: mailbox empty, frame received
    assert (word(CAN + 0x204), word(CAN + 0x20C), word(CAN + 0x21C)) == (0, 1, 1)
    assert word(CAN + 0x240) == 0x110 << 21
    assert word(CAN + 0x244) == 0x7FF << 21 | 0b110
    assert word(RCC + 0x40) & 1 << 25
    assert word(GPIOA + AFRH) == 9 << 12 | 9 << 16
