from motord.virtual.mesh import processors


def test_a_pool_is_kept_from_test_to_test() -> None:
    with processors() as one:
        assert one.submit(abs, -1).result() == 1
    with processors() as other:
        assert other is one
        assert other.submit(abs, -2).result() == 2
