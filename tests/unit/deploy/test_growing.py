"""Row files read as they grow: every row once, whatever their writer does to them."""

from hypothesis import given
from hypothesis import strategies as st
from made_rows import episode_row

from railctl.common.records.rows import EpisodeRow
from railctl.common.rows import RowFile
from railctl.deploy.growing import GrowingFile, GrowingRows


def numbers(rows):
    return [row.episode for row in rows.fresh()]


def test_rows_come_once_and_a_torn_one_when_it_is_whole(tmp_path):
    path = tmp_path / "rows.jsonl"
    rows = GrowingRows(path, EpisodeRow)
    assert numbers(rows) == []
    line = episode_row(0).model_dump_json(by_alias=True)
    path.write_text(f"{line}\n{line[:20]}")
    assert numbers(rows) == [0]
    path.write_text(f"{line}\n{line}\n")
    assert numbers(rows) == [0]
    assert numbers(rows) == []


@given(st.lists(st.tuples(st.sampled_from(["append", "cut", "read"]), st.integers(0, 6)), max_size=30))
def test_every_position_is_read_once_whatever_is_cut_and_written_again(tmp_path_factory, steps):
    path = tmp_path_factory.mktemp("rows") / "rows.jsonl"
    file, rows, read, longest = RowFile(path, EpisodeRow), GrowingRows(path, EpisodeRow), [], 0
    for number, (verb, count) in enumerate([*steps, ("read", 0)]):
        if verb == "append":
            for _ in range(count):  # times differ when an episode is written again
                file.append(episode_row(file.count, trained_unix_s=1000.0 + 100 * number))
        elif verb == "cut":
            file.cut(max(0, file.count - count))
        else:
            read += numbers(rows)
            longest = max(longest, file.count)
    assert read == list(range(longest))
    file.close()


def follower(path):
    return GrowingFile(path, int)


def test_values_of_lines_come_once(tmp_path):
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
