"""Chen and Little's method: the homography of the synthetic camera that sees most nearly what an image shows, refined.

Chen, Little: Sports Camera Calibration via Synthetic Data, CVPR workshops 2019. Written from the paper. Markings, as
thin lines, are looked up in a database of synthetic cameras by a short feature, and the distance images of the view
that was found and of the markings are aligned.

    python -m baselines.chen database FILE
    python -m baselines.chen INPUT --size 1280x720 --database FILE --out DIR
    python -m baselines.chen train MODEL

`cameras` draws them, `edges` draws what they see, `features` and `database` find the nearest, `refinement` aligns,
`search` is all of it; `training` needs PyTorch, the other modules do not.
"""
