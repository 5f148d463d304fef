"""Row files read as they grow: every row once, whatever their writer does to them."""

from hypothesis import given
from hypothesis import strategies as st
from made_rows import episode_row

from railctl.common.records.rows import EpisodeRow
from railctl.common.rows import RowFile
from railctl.deploy.growing import GrowingRows


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
