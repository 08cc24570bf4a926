"""Chunks that are kept are taken again if they are whole, and computed anew if not."""

import numpy as np

from framework.numerics.kept import KeptChunks


def test_what_is_torn_is_not_taken(tmp_path):
    kept = KeptChunks.of(tmp_path, {"what": 1})
    kept.keep("whole", {"a": np.arange(3.0)})
    for name, content in (("empty", b""), ("torn", (kept.folder / "whole.npz").read_bytes()[:60])):
        (kept.folder / f"{name}.npz").write_bytes(content)
    assert set(kept.read()) == {"whole"}
    np.testing.assert_array_equal(kept.read()["whole"]["a"], np.arange(3.0))
