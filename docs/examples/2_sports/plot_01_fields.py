"""
The fields of the package
=========================

Every field that comes with the package: its map, and a view of it rendered from a stand.
"""

import matplotlib.pyplot as plt

import fieldcalib
from fieldcalib.draw import contact_sheet, draw_minimap, render_field


def show(names):
    """Maps and views of some fields, in rows of two."""
    pictures = []
    for name in names:
        field = fieldcalib.field(name)
        reach = max(field.length, field.width)
        camera = fieldcalib.Camera.from_angles(0.0, 1.0, 0.0, 430.0, (0.0, 0.78 * reach, -0.5 * reach), (480, 300))
        pictures += [draw_minimap(None, field, size=(480, 300)), render_field(camera, field)]
    sheet = contact_sheet(pictures, [text for name in names for text in (name, "")], columns=4, width=360)
    plt.figure(figsize=(12, 9))
    plt.imshow(sheet[..., ::-1])
    plt.axis("off")
    plt.tight_layout(pad=0)


# %%
# Courts
show(["badminton", "basketball-fiba", "basketball-nba", "futsal", "handball", "padel", "tennis", "volleyball"])

# %%
# More of them, each a file with the sources of its numbers
courts = ["basketball-ncaa", "basketball-nfhs", "basketball-3x3", "basketball-half", "pickleball", "beach-volleyball"]
show([*courts, "lacrosse-men", "rugby-league", "soccer-9v9", "soccer-7v7", "soccer-5v5"])

# %%
# Rinks and turf
turf = ["soccer", "rugby-union", "american-football-nfl", "american-football-ncaa", "field-hockey"]
show([*turf, "ice-hockey-nhl", "ice-hockey-nhl-2013", "ice-hockey-iihf"])
