"""Shares of a study: between them they do all of it, and nothing twice."""

from collections import Counter
from itertools import chain

import pytest

from railctl.analysis.study import Study, StudyFolder, planned_runs
from railctl.common.strict import ConfigError
from railctl.deploy.runs import Failed
from railctl.deploy.study.dispatcher import Reporting, in_order
from railctl.deploy.study.shares import Share, parse_share
from railctl.deploy.study.work import alone

STUDY = Study.model_validate(
    {
        "name": "made",
        "contenders": ["dqn", "ppo"],
        "levels": ["easy", "medium", "hard"],
        "seeds": [1, 2, 3, 4],
        "episodes": 300,
        "references": ["random", "planner"],
    }
)
JOBS = in_order(STUDY, {}, set())


@pytest.mark.parametrize("out_of", [1, 2, 5, 6, 7, 24])
def test_shares_are_all_of_a_study_but_its_report_once(out_of):
    shares = [Share(number, out_of).jobs(STUDY, JOBS) for number in range(1, out_of + 1)]
    assert Counter(chain(*shares)) == Counter(job for job in JOBS if not isinstance(job, Reporting))
    sizes = [len(Share(number, out_of).runs(STUDY)) for number in range(1, out_of + 1)]
    assert max(sizes) - min(sizes) <= 1


def test_a_network_is_scored_by_the_share_that_trained_it():
    jobs = Share(2, 5).jobs(STUDY, JOBS)
    runs = Share(2, 5).runs(STUDY)
    assert {job.run for job in jobs if hasattr(job, "run")} == {job for job in jobs if job in set(runs)} == set(runs)


def test_the_order_of_jobs_stays():
    jobs = Share(1, 3).jobs(STUDY, JOBS)
    assert jobs == sorted(jobs, key=JOBS.index)


def test_each_share_gets_of_every_contender_and_level():
    for number in range(1, 5):
        assert Counter(run[:2] for run in Share(number, 4).runs(STUDY)) == Counter(
            {run[:2] for run in planned_runs(STUDY)}
        )


@pytest.mark.parametrize("text", ["0/8", "9/8", "a/b", "1/0", "2", "1/2/3", "-1/8", "1 / 8", "٢/٨"])
def test_what_is_no_share_is_refused(text):
    with pytest.raises(ConfigError, match=r"^--share .*: write I/N, with I from 1 to N, as 2/8$"):
        parse_share(text, STUDY)


def test_a_share_is_read_as_it_is_written():
    assert str(parse_share("2/8", STUDY)) == "2/8"
    assert parse_share("24/24", STUDY) == Share(24, 24)


def test_more_shares_than_runs_are_refused():
    with pytest.raises(ConfigError, match="--share 1/25: study made has 24 runs, make it 1 to 24 shares"):
        parse_share("1/25", STUDY)


def test_only_other_shares_of_as_many_work_beside_one(tmp_path):
    folder = StudyFolder(tmp_path)
    with alone(folder, Share(1, 3)), alone(folder, Share(2, 3)):
        for other in (Share(1, 3), Share(3, 4), None):
            with pytest.raises(Failed, match="works on study"), alone(folder, other):
                pass
    with alone(folder), pytest.raises(Failed, match="works on study"), alone(folder, Share(1, 3)):
        pass
