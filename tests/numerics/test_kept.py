"""Chunks that are kept are taken again if they are whole, and computed anew if not."""

import random

import numpy as np

from framework.numerics.kept import ArrayField, KeptChunks, fits


def test_what_is_torn_is_not_taken(tmp_path):
    kept = KeptChunks.of(tmp_path, {"what": 1})
    kept.keep("whole", {"a": np.arange(3.0)})
    for name, content in (("empty", b""), ("torn", (kept.folder / "whole.npz").read_bytes()[:60])):
        (kept.folder / f"{name}.npz").write_bytes(content)
    assert set(kept.read()) == {"whole"}
    np.testing.assert_array_equal(kept.read()["whole"]["a"], np.arange(3.0))


def test_what_has_other_lengths_names_or_kinds_of_values_does_not_fit():
    table = {"a": ArrayField("f", (3,)), "why": ArrayField("U", (3,))}
    good = {"a": np.zeros(3), "why": np.array(["", "", "lost"])}
    assert fits(good, table)
    assert not fits(None, table)
    for other in ({"a": np.zeros(2)}, {"a": np.zeros(3, int)}, {"why": np.zeros(3)}, {"b": np.zeros(3)}):
        assert not fits({**good, **other}, table)
    assert not fits({"a": good["a"]}, table)


def test_a_chunk_with_damaged_bytes_is_whole_or_absent(tmp_path):
    kept = KeptChunks.of(tmp_path, {"what": 1})
    kept.keep("chunk", {"a": np.arange(3.0), "why": np.array(["", "lost"])})
    file = kept.folder / "chunk.npz"
    whole = file.read_bytes()
    chance = random.Random(57)
    for _ in range(300):  # a third of these raise something else than BadZipFile
        damaged = bytearray(whole)
        damaged[chance.randrange(len(whole))] = chance.randrange(256)
        file.write_bytes(damaged)
        assert set(kept.read()) <= {"chunk"}
