"""Fetches public data sets: download, check, unpack."""

from __future__ import annotations

from rgbd_glue_ros.recordings.fetch.catalogue import CATALOGUE, Source, find
from rgbd_glue_ros.recordings.fetch.fetch import Fetched, fetch

__all__ = ["CATALOGUE", "Fetched", "Source", "fetch", "find"]
