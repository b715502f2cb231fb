"""Jiang et al., "Optimizing Through Learned Errors for Accurate Sports Field Registration" (WACV 2020).

    python -m baselines.jiang train OUT --pictures DIR --homographies DIR
    python -m baselines.jiang run IMAGES --size 1280x720 --weights WEIGHTS --out DIR

For comparison only. It was written from the paper, whose method is the subject of patent applications; it is not part
of the installed package and has no weights.

A network predicts where four points of the picture lie on the field, which gives a homography (`four_points`). A second
network predicts the error of a homography, from the picture and the field warped by it. That error is differentiable by
the four points, and Adam moves them so that it falls (`optimiser`). To see what a learned error adds, the cost may also
be the distance of labelled pixels from the projected markings (`lines`). Needs PyTorch: the extra ``train``.
"""
