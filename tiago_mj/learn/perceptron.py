"""Multilayer perceptrons with ReLU whose parameters are one flat array, with gradients by backpropagation layer by
layer.

This avoids the bookkeeping of automatic differentiation and gradients that are not needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Perceptron:
    """Linear layers with ReLU between them.

    Attributes:
        flat: all its numbers, (n,).
        weights: views of it, (out, in) each.
        biases: views of it, (out,) each.
    """

    flat: Tensor
    weights: tuple[Tensor, ...]
    biases: tuple[Tensor, ...]

    def forward(self, x: Tensor) -> list[Tensor]:
        """The input and every layer's output, the last without ReLU."""
        values = [x]
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            values.append(torch.addmm(bias, values[-1], weight.t()).relu_())
        values.append(torch.addmm(self.biases[-1], values[-1], self.weights[-1].t()))
        return values

    def backward(self, values: Sequence[Tensor], gradient: Tensor, into: Perceptron | None) -> Tensor:
        """Backpropagate a gradient.

        Args:
            values: of :meth:`forward`.
            gradient: of a loss by the output, (batch, out).
            into: where the gradient by this perceptron's numbers goes; None: nowhere.

        Returns:
            The gradient by the output of the first layer, before its ReLU, (batch, out).
        """
        for k in reversed(range(len(self.weights))):
            if into is not None:
                torch.mm(gradient.t(), values[k], out=into.weights[k])
                torch.sum(gradient, 0, out=into.biases[k])
            if k:
                gradient = torch.ops.aten.threshold_backward(torch.mm(gradient, self.weights[k]), values[k], 0)
        return gradient


def stacked(networks: Sequence[Sequence[Tensor]]) -> tuple[Tensor, list[Perceptron]]:
    """Perceptrons whose parameters are consecutive in one array.

    Args:
        networks: of each, weight and bias of every layer in turn.
    """
    flat = torch.cat([part.detach().reshape(-1) for network in networks for part in network])
    found, begin = [], 0
    for network in networks:
        first, views = begin, []
        for part in network:
            views.append(flat[begin : begin + part.numel()].view(part.shape))
            begin += part.numel()
        found.append(Perceptron(flat[first:begin], tuple(views[::2]), tuple(views[1::2])))
    return flat, found
