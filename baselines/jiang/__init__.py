"""Jiang et al., "Optimizing Through Learned Errors for Accurate Sports Field Registration" (WACV 2020).

    python -m baselines.jiang train OUT --pictures DIR --homographies DIR
    python -m baselines.jiang run IMAGES --size 1280x720 --weights WEIGHTS --out DIR

For comparison only: written from the paper, whose method is the subject of patent applications. It stays out of the
package that is installed, and comes without weights.

A network guesses where four points of the picture lie on the field, which gives a homography (`four_points`). A second
network predicts from the picture and the field warped by a homography how well they overlap; its input is
differentiable by the four points, which are moved by Adam so that the predicted error falls (`optimiser`). The same
steps with the distances of labelled pixels from the projected markings as the cost (`lines`) show what the learned
error adds. Needs PyTorch: the extra ``train``.
"""
