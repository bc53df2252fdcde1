"""Data sets that can be downloaded without an agreement, and where they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from rgbd_glue_ros.errors import InputError


@dataclass(frozen=True)
class Source:
    """An archive of one or more recordings.

    Attributes:
        name: the name for the user.
        url: of the archive.
        folder: the folder that it is unpacked to.
        licence: in a few words.
        sha256: of the archive, hexadecimal, if a trusted one exists; none of the publishers below
            gives any.
    """

    name: str
    url: str
    folder: str
    licence: str
    sha256: str | None = None


_TUM = "https://cvg.cit.tum.de/rgbd/dataset"
_TUM_SEQUENCES = {
    1: "360 desk desk2 floor plant room rpy teddy xyz",
    2: "360_hemisphere 360_kidnap coke desk desk_with_person dishes flowerbouquet "
    "flowerbouquet_brownbackground large_no_loop large_with_loop metallic_sphere "
    "metallic_sphere2 pioneer_360 pioneer_slam pioneer_slam2 pioneer_slam3 rpy xyz",
    3: "cabinet large_cabinet long_office_household nostructure_notexture_far "
    "nostructure_notexture_near_withloop nostructure_texture_far "
    "nostructure_texture_near_withloop sitting_halfsphere sitting_rpy sitting_static sitting_xyz "
    "structure_notexture_far structure_notexture_near structure_texture_far "
    "structure_texture_near teddy walking_halfsphere walking_rpy walking_static walking_xyz",
}

_ICL = "https://www.doc.ic.ac.uk/~ahanda"
_ICL_ROOMS = {"living_room": "living_room_traj", "office": "traj"}

_SEVEN = "https://download.microsoft.com/download/2/8/5/28564B23-0828-408F-8631-23B1EFF1DAC8"
_SEVEN_SCENES = "chess fire heads office pumpkin redkitchen stairs"


def _catalogue() -> list[Source]:
    sources = []
    for camera, names in _TUM_SEQUENCES.items():
        for name in names.split():
            folder = f"rgbd_dataset_freiburg{camera}_{name}"
            url = f"{_TUM}/freiburg{camera}/{folder}.tgz"
            sources.append(Source(f"tum/fr{camera}_{name}", url, folder, "CC BY 4.0"))
    for room, prefix in _ICL_ROOMS.items():
        for i in range(4):
            url = f"{_ICL}/{prefix}{i}_frei_png.tar.gz"
            folder = f"icl_nuim_{room}_traj{i}"
            sources.append(Source(f"icl-nuim/{room}_traj{i}", url, folder, "CC BY 3.0"))
    for scene in _SEVEN_SCENES.split():
        url = f"{_SEVEN}/{scene}.zip"
        licence = "Microsoft, not commercial"
        sources.append(Source(f"7-scenes/{scene}", url, scene, licence))
    return sources


CATALOGUE: Mapping[str, Source] = {source.name: source for source in _catalogue()}


def find(name: str) -> Source:
    """The source of a name.

    Raises:
        InputError: no source has this name.
    """
    if name in CATALOGUE:
        return CATALOGUE[name]
    similar = get_close_matches(name, CATALOGUE)
    hint = f"did you mean {' or '.join(similar)}? Otherwise " if similar else ""
    raise InputError(
        name, "is not an available data set", f"{hint}give one listed by 'rgbd-glue fetch'"
    )
