"""List of the operators that an exported program may use: operators of PyTorch that only compute with tensors.

A program names its operators in text, and only names on this list are looked up. The list has no functions of Python,
and no operators that read files, print, change their arguments, or return memory that was never written.
"""

from collections.abc import Callable
from typing import Any

import torch

_NAMES = """
abs.default add.Scalar add.Tensor addmm.default affine_grid_generator.default all.default all.dim amax.default
amin.default any.default any.dim
alias.default
arange.default arange.start arange.start_step argmax.default argmin.default asin.default acos.default atan.default
atan2.default avg_pool1d.default avg_pool2d.default adaptive_avg_pool1d.default adaptive_avg_pool2d.default
baddbmm.default batch_norm.default bitwise_and.Tensor bitwise_not.default bitwise_or.Tensor bmm.default
broadcast_to.default
cat.default ceil.default chunk.default clamp.default clamp.Tensor clamp_max.default clamp_min.default clone.default
constant_pad_nd.default contiguous.default conv1d.default conv1d.padding conv2d.default conv2d.padding conv3d.default
conv_transpose1d.default conv_transpose2d.input cos.default cumsum.default
detach.default diagonal.default div.Scalar div.Tensor div.Tensor_mode dropout.default
einsum.default elu.default embedding.default eq.Scalar eq.Tensor erf.default exp.default
expand.default expm1.default
feature_dropout.default flatten.using_ints flip.default floor.default floor_divide.default fmod.Scalar frac.default
full.default full_like.default
gather.default ge.Scalar ge.Tensor gelu.default glu.default grid_sampler.default grid_sampler_2d.default
group_norm.default gru.input gt.Scalar gt.Tensor
hardsigmoid.default hardswish.default hardtanh.default
index.Tensor index_select.default instance_norm.default isfinite.default isinf.default isnan.default
layer_norm.default le.Scalar le.Tensor leaky_relu.default lift_fresh_copy.default linalg_vector_norm.default
linear.default log.default log1p.default log_softmax.int logical_and.default logical_not.default logical_or.default
logsumexp.default lstm.input lt.Scalar lt.Tensor
masked_fill.Scalar masked_fill.Tensor matmul.default max.default max.dim max.other max_pool1d.default
max_pool2d.default maximum.default mean.default mean.dim min.default min.dim min.other minimum.default mish.default
mm.default movedim.int mul.Scalar mul.Tensor mv.default
narrow.default ne.Scalar ne.Tensor neg.default new_full.default new_ones.default new_zeros.default norm.ScalarOpt_dim
numpy_T.default
ones.default ones_like.default outer.default
pad.default permute.default pixel_shuffle.default pixel_unshuffle.default pow.Scalar pow.Tensor_Scalar
pow.Tensor_Tensor prelu.default prod.default prod.dim_int
reciprocal.default relu.default relu6.default remainder.Scalar remainder.Tensor repeat.default
repeat_interleave.self_int reshape.default rms_norm.default roll.default round.default rsqrt.default rsub.Scalar
scaled_dot_product_attention.default select.int selu.default sigmoid.default sign.default silu.default sin.default
slice.Tensor softmax.int softplus.default split.Tensor split_with_sizes.default split.sizes sqrt.default
square.default squeeze.default squeeze.dim squeeze.dims stack.default std.default std.dim std.correction sub.Scalar
sub.Tensor sum.default sum.dim_IntList
t.default tan.default tanh.default tile.default to.device to.dtype to.dtype_layout topk.default transpose.int
tril.default triu.default
unbind.int unflatten.int unfold.default unsqueeze.default upsample_bicubic2d.vec upsample_bilinear2d.vec
upsample_nearest2d.vec _upsample_bilinear2d_aa.vec _upsample_bicubic2d_aa.vec
var.default var.dim var.correction view.default view_as.default vstack.default
where.self where.ScalarOther where.ScalarSelf where.Scalar
zeros.default zeros_like.default
"""
_PREFIX = "torch.ops.aten."
_ALSO = {"detach_.default": "detach.default"}
"""Operators that `torch.export` writes although they change nothing, and the allowed operators that do the same."""
_CHECKS = f"{_PREFIX}_assert_tensor_metadata.default"

Operator = Callable[..., Any]


def is_check(target: str) -> bool:
    """Return whether a step of a program only checks tensors, and produces no value.

    Args:
        target: Name of the step's operator.
    """
    return target == _CHECKS


def operator(target: str) -> Operator | None:
    """Return the operator of a name, or None if programs may not use it.

    Args:
        target: Name of the operator, such as ``torch.ops.aten.relu.default``.
    """
    name = target.removeprefix(_PREFIX)
    name = _ALSO.get(name, name)
    if not target.startswith(_PREFIX) or name not in _ALLOWED:
        return None
    packet, overload = name.split(".")
    found: Operator = getattr(getattr(torch.ops.aten, packet), overload)
    return found


_ALLOWED = frozenset(_NAMES.split())
