"""The layout of the parameters of frames that are solved together."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from fieldcalib.problem.layout import CENTER, LOG_F, Layout, Role, SizeBlock, ZoomLaw
from fieldcalib.solve.sequence_problem import SequenceProblem

# Parameters that each part of the zoom law changes: the part is fixed unless these are shared.
CHANGED = {"cx slope": "cx", "cy slope": "cy", "a1 slope": "a1", "a1 bend": "a1"}


def joint_layout(problem: SequenceProblem, reference: float, fixed_sizes: Collection[str]) -> Layout:
    """Layout of a frame with the shared parameters of all frames; parameters that the flags fix stay fixed.

    Parameters
    ----------
    reference : float
        Reference log f of the zoom law.
    fixed_sizes : collection of str
        Those of length and width that are kept at an uncertain value.
    """
    base = problem.options.layout
    law = ZoomLaw(reference) if "zoom law" in problem.shared and base.free[LOG_F] else None
    layout = Layout.of(base.image_size, base.lens, _free_size(problem), law)
    roles = layout.roles.copy()
    roles[: base.lens_block.stop] = base.roles[: base.lens_block.stop]
    shared = {*problem.shared, *(("aspect",) if {"principal point", "lens"} & set(problem.shared) else ())}
    for name in shared & layout.blocks.keys():
        block = layout.blocks[name]
        roles[block] = np.where(roles[block] == Role.FRAME, Role.SHARED, Role.FIXED)
    index = {name: k for k, name in enumerate(layout.names)}
    for name in fixed_sizes:
        roles[index[name]] = Role.CONSIDERED
    if law is not None:
        unshared = [part for part, of in CHANGED.items() if of not in index or roles[index[of]] != Role.SHARED]
        is_known = problem.moves or not np.any(base.free[CENTER])  # a known centre is the centre of projection
        for name in (*unshared, *(("axis offset",) if is_known else ())):
            roles[index[name]] = Role.FIXED
    return replace(layout, roles=roles)


def _free_size(problem: SequenceProblem) -> SizeBlock | None:
    """Length and width, with the prior for fields of estimated size; None if the size is not a parameter."""
    field = problem.options.field
    if problem.options.layout.field_size is None or field is None:
        return None
    model = field.size_model
    assert model is not None
    return SizeBlock(np.array([field.length, field.width]), model.sigma, model.limits, crown=model.crown)
