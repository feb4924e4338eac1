import numpy as np

from motord.emulate.truth_log import TruthLog


def fill(log: TruthLog, torques_Nm, on=1):
    for torque_Nm in torques_Nm:
        row = log.next_row()
        row.torque_Nm, row.inverter_on = torque_Nm, on


def test_blocks_reach_the_sink_whole_and_in_order():
    blocks = []
    log = TruthLog(20, blocks.append)  # blocks of 10
    fill(log, range(25))
    log.flush()
    log.flush()
    assert [len(block) for block in blocks] == [10, 10, 5]
    assert np.concatenate(blocks)["torque_Nm"].tolist() == list(range(25))


def test_a_full_block_makes_room_for_the_next_row():
    blocks = []
    log = TruthLog(4, blocks.append)
    for _ in range(3):
        log.next_row()
    assert [len(block) for block in blocks] == [2]


def test_the_mean_torque_is_that_while_the_power_stage_was_on():
    log = TruthLog(4, None)
    assert log.mean_torque_Nm is None
    fill(log, [100.0, 100.0, 100.0], on=0)
    fill(log, [1.0, 2.0, 6.0])
    log.flush()
    assert (log.mean_torque_Nm, log.on_rows) == (3.0, 3)
