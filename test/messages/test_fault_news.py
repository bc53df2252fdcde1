"""Which faults are told where what is wrong comes and goes."""

from __future__ import annotations

from rgbd_glue_ros.messages.fault_news import MAX_FAULTS, FaultNews


def test_a_fault_that_returns_after_a_time_without_faults_is_new_again() -> None:
    news = FaultNews(lambda: 0)
    assert news.is_news("/depth", "7 of 10 are missing")
    assert not news.is_news("/depth", "8 of 10 are missing")
    news.forget()
    assert news.is_news("/depth", "9 of 10 are missing")


def test_a_fault_that_comes_and_goes_does_not_flood_the_log() -> None:
    news = FaultNews(lambda: 0)
    told = 0
    for _ in range(500):
        told += news.is_news("/depth", "missing")
        news.forget()
    assert told == MAX_FAULTS
