"""Following a file that grows, is cut, and goes."""

from railctl.deploy.web.row_follower import RowFollower


def follower(path):
    return RowFollower(path, int)


def test_rows_come_once(tmp_path):
    path = tmp_path / "rows"
    rows = follower(path)
    assert list(rows.new()) == []  # there is no file yet
    path.write_text("1\n2\n3")
    assert list(rows.new()) == [1, 2]  # the last line is not whole
    with path.open("a") as file:
        file.write("4\n")
    assert list(rows.new()) == [34]
    assert list(rows.new()) == []
    assert not rows.was_cut()


def test_what_is_no_row_is_passed_over(tmp_path):
    path = tmp_path / "rows"
    path.write_text("1\nx\n2\n")
    assert list(follower(path).new()) == [1, 2]


def test_a_file_that_was_cut_and_has_grown_again_is_read_anew(tmp_path):
    path = tmp_path / "rows"
    path.write_text("1\n2\n3\n")
    rows = follower(path)
    assert list(rows.new()) == [1, 2, 3]
    path.write_text("1\n2\n5\n6\n")
    assert rows.was_cut()
    rows.restart()
    assert list(rows.new()) == [1, 2, 5, 6]


def test_a_file_that_is_gone_was_cut(tmp_path):
    path = tmp_path / "rows"
    path.write_text("1\n")
    rows = follower(path)
    list(rows.new())
    path.unlink()
    assert rows.was_cut()
