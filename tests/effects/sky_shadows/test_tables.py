"""The tables behind shadows under the sky: wavelets of codes, and caps kept on disk."""

from __future__ import annotations

import torch

from torchrender.effects.sky_shadows.tables import build_table, cap_table, code_wavelets, table_file
from torchrender.numerics.wavelets.haar import first, transform


def test_codes_as_the_specification_has_them() -> None:
    wanted = [6, -4, 4, -2, -2, 2, -2, 0, 0, 0, 0, 0, 0, -2, 2, -2]
    assert code_wavelets()[0x7310].tolist() == wanted
    assert code_wavelets()[0xFFFF].tolist() == [16] + [0] * 15


def test_looked_up_codes_are_the_finest_wavelets() -> None:
    """Means of blocks, and the two finest levels, of bits at random."""
    bits = torch.rand(6, 32, 32, generator=torch.Generator().manual_seed(9)) < 0.4
    made = transform(bits.double())
    blocks = bits.reshape(6, 8, 4, 8, 4).transpose(2, 3).reshape(6, 64, 16).long()
    codes = (blocks << (15 - torch.arange(16))).sum(-1)
    found = torch.from_numpy(code_wavelets())[codes].double() / 16.0
    assert torch.equal(found[..., 0], made.means[:, first(3) : first(4)])
    assert torch.equal(found[..., 1:4] / 8.0, made.wavelets[:, first(3) : first(4)])
    quarters = found[..., 4:].reshape(6, 8, 8, 2, 2, 3).transpose(2, 3).reshape(6, 256, 3)
    assert torch.equal(quarters / 8.0, made.wavelets[:, first(4) :])
    coarse = transform(found[..., 0].reshape(6, 8, 8))
    assert torch.equal(coarse.wavelets, made.wavelets[:, : first(3)]) and torch.equal(
        coarse.means, made.means[:, : first(3)]
    )


def test_the_table_is_kept_and_a_damaged_one_is_made_again(tmp_path, monkeypatch, caplog) -> None:  # type: ignore[no-untyped-def]
    import torchrender.effects.sky_shadows.tables as tables

    bits, _ = cap_table(32)
    assert bits.nbytes == 150_994_944
    monkeypatch.setattr(tables, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(tables, "build_table", build_table)
    cap_table.cache_clear()
    try:
        with caplog.at_level("INFO", logger="torchrender.sky_shadows"):
            made, _ = tables.cap_table(16)
        assert "once" in caplog.text and table_file(16).is_file()
        whole = table_file(16).stat().st_size
        table_file(16).unlink()  # a file that is mapped must not shrink
        table_file(16).write_bytes(b"torn")
        cap_table.cache_clear()
        again, _ = tables.cap_table(16)
        assert table_file(16).stat().st_size == whole and (again[::997] == made[::997]).all()
    finally:
        cap_table.cache_clear()
