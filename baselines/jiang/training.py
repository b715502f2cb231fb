"""Training of the two networks. Weights and logs are written into one folder."""

from __future__ import annotations

import io
import json
import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader

from baselines.jiang.networks import ErrorNetwork, GuessNetwork
from baselines.jiang.training_pairs import Batches
from fieldcalib._whole_files import write_bytes

LEARNING_RATE, WARM_UP, WEIGHT_DECAY = 1e-3, 100, 1e-4
REPORTED = 100  # steps between two lines of the log
GUESS, ERROR = "guess.pt", "error.pt"


def train_guess(batches: Batches, out: Path, width: int, size: int, steps: int, minutes: float) -> None:
    """Train the first network: mean square error of the coordinates of the four points."""
    network = GuessNetwork(width, size)

    def loss(pictures: Tensor, points: Tensor, others: Tensor, overlaps: Tensor) -> Tensor:
        return torch.mean(torch.square(network(pictures) - points))

    _train(network, loss, batches, out / GUESS, steps, minutes)


def train_error(batches: Batches, out: Path, width: int, size: int, steps: int, minutes: float) -> None:
    """Train the second network: mean square error of the predicted error of perturbed points."""
    network = ErrorNetwork(width, size)

    def loss(pictures: Tensor, points: Tensor, others: Tensor, overlaps: Tensor) -> Tensor:
        return torch.mean(torch.square(network(pictures, others) - (1.0 - overlaps)))

    _train(network, loss, batches, out / ERROR, steps, minutes)


def _train(
    network: GuessNetwork | ErrorNetwork,
    loss_of: Callable[..., Tensor],
    batches: Batches,
    path: Path,
    steps: int,
    minutes: float,
) -> None:
    """Train by AdamW until the steps or the minutes are over.

    After a short warm-up the learning rate falls to 0 as half a cosine. Weights are written every few steps and at the
    end.
    """
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    network.to(device).train()
    optimizer = torch.optim.AdamW(network.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    log_file = path.with_suffix(".jsonl")
    log_file.unlink(missing_ok=True)
    losses: list[float] = []
    start = time.monotonic()
    for step, batch in enumerate(DataLoader(batches, batch_size=None, sampler=range(steps), num_workers=1), 1):
        done = max(step / steps, (time.monotonic() - start) / (60.0 * minutes))
        for group in optimizer.param_groups:
            group["lr"] = LEARNING_RATE * min(1.0, step / WARM_UP) * 0.5 * (1.0 + math.cos(math.pi * min(done, 1.0)))
        pictures, *numbers = (part.to(device) for part in batch)
        with torch.autocast(device.type, torch.bfloat16):  # takes half the time on processors that have it
            loss = loss_of(pictures.contiguous(memory_format=torch.channels_last), *numbers)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
        if step % REPORTED == 0 or done >= 1.0:
            row = {"step": step, "loss": float(np.mean(losses)), "seconds": round(time.monotonic() - start)}
            with log_file.open("a") as log:
                print(json.dumps(row), file=log)
            losses = []
            save(network, path)
        if done >= 1.0:
            break


def save(network: GuessNetwork | ErrorNetwork, path: Path) -> None:
    """Write the weights of a network, whole or not at all."""
    buffer = io.BytesIO()
    torch.save({"width": network.width, "size": network.size, "state": network.state_dict()}, buffer)
    write_bytes(path, buffer.getvalue())
