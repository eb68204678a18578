"""AprilTags in dome masters."""

import numpy as np
import pytest

from procam.estimate.media_server.dome_master import DomeMaster
from procam.estimate.media_server.tags import TAG_PICTURES, draw_tags, master_tags
from procam.maths.codes.shot_id import CELLS_PER_MASTER, shot_id_pixels
from procam.maths.geometry.lenses import project, unproject
from procam.maths.geometry.sphere import direction_from_angles

SIZE = 512


@pytest.mark.parametrize("picture", range(TAG_PICTURES))
@pytest.mark.parametrize("size", [512, 4096])
def test_tags_are_many_and_clear_of_the_shot_mark(size: int, picture: int) -> None:
    tags = master_tags(size, np.pi, picture)
    assert 20 <= len(tags) <= 35  # the family's
    assert [t.number for t in tags] == list(range(len(tags)))
    if size == 512:
        drawn = draw_tags(DomeMaster("server", size).model, tags, np.pi)
        assert not drawn[..., 0][shot_id_pixels((size, size), CELLS_PER_MASTER)].any()


def test_centres_have_the_stated_directions() -> None:
    """The centroid of the light of a full white tag, on the sphere."""
    master = DomeMaster("server", SIZE, rotation=0.3)
    tag = master_tags(SIZE, np.pi, 0)[7]
    drawn = draw_tags(master.model, [tag], np.pi)[..., 0] > 0
    rows, columns = np.nonzero(drawn)
    box = np.array([[columns.min(), rows.min()], [columns.max(), rows.max()]]).mean(axis=0)
    ray = unproject(box, master.model.lens)
    assert np.degrees(np.arccos(ray @ tag.ray)) < 0.5  # a pixel is a third of a degree
    mark = tag.on_dome(master.model, 0.001)
    assert mark.azimuth is not None and mark.elevation is not None
    place = direction_from_angles(mark.azimuth, mark.elevation)
    np.testing.assert_allclose(
        project(master.model.projector_from_dome.apply(6.0 * place), master.model.lens),
        project(tag.ray, master.model.lens),
    )


def test_edges_send_the_light_of_the_part_that_is_white() -> None:
    """A coarse picture against the mean light of one with a quarter of its pixels' width."""
    tag = master_tags(SIZE, np.pi, 0)[7]
    coarse, fine = (
        (draw_tags(DomeMaster("server", size).model, [tag], np.pi)[..., 0] / 255) ** 2.2
        for size in (SIZE, 4 * SIZE)
    )
    mean = fine.reshape(SIZE, 4, SIZE, 4).mean(axis=(1, 3))
    grey = (mean > 0.1) & (mean < 0.9)
    assert grey.sum() > 50
    assert np.abs(coarse - mean)[grey].mean() < 0.03
