"""How a person looks: colors and hair, given by name or drawn by seed."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from blendcap.data import InputError

Color = tuple[float, float, float]
CUTS = ("bald", "buzz", "short")


@dataclass(frozen=True)
class Look:
    """Colors (linear RGB, 0 to 1) and hair of one person; lengths in mm on the plain mannequin.

    Parameters
    ----------
    skin, lips, hair, iris : (3,)
    blush : float
        Of cheeks, nose and chin; 1 is usual.
    blotches : float
        Uneven color of the skin; 1 is usual.
    shade : float
        Darkness round the eyes; 1 is usual.
    brow_height, brow_arch, brow_density : float
        Height of the brow at its inner end, mm; rise of its arch, 1 is usual; 0 to 1.
    lashes, stubble, freckles : float
        0 (none) to 1.
    moles : float
        Share of the places for a mole that have one.
    cut : str
        bald, buzz or short.
    hairline, temples : float
        How far the hair has drawn back over the forehead and at the temples, mm.
    grain : int
        Seed of all noise on the skin.
    """

    skin: Color = (0.62, 0.42, 0.33)
    lips: Color = (0.50, 0.19, 0.17)
    hair: Color = (0.10, 0.065, 0.045)
    iris: Color = (0.30, 0.20, 0.11)
    blush: float = 1.0
    blotches: float = 1.0
    shade: float = 1.0
    brow_height: float = 8.4
    brow_arch: float = 1.0
    brow_density: float = 0.9
    lashes: float = 0.93
    stubble: float = 0.0
    freckles: float = 0.0
    moles: float = 0.0
    cut: str = "buzz"
    hairline: float = 0.0
    temples: float = 0.0
    grain: int = 0

    def __post_init__(self):
        if self.cut not in CUTS:
            raise InputError(f"There is no cut {self.cut!r}; choose one of {', '.join(CUTS)}.")

    def but(self, **features) -> Look:
        """The same look with other features, by the names above.

        Raises
        ------
        InputError
            If a look has no such feature.
        """
        known = [field.name for field in fields(self)]
        if unknown := [name for name in features if name not in known]:
            raise InputError(f"A look has no feature {unknown[0]!r}; it has {', '.join(known)}.")
        return replace(self, **features)


LOOKS = {
    "plain": Look(),
    "ada": Look((0.68, 0.47, 0.38), (0.50, 0.12, 0.13), (0.075, 0.04, 0.03), (0.20, 0.28, 0.30), brow_height=6.6,
                brow_arch=1.25, lashes=1.0, freckles=0.5, cut="short", grain=1),
    "kofi": Look((0.20, 0.105, 0.065), (0.19, 0.07, 0.06), (0.018, 0.013, 0.011), (0.07, 0.04, 0.025), stubble=0.5,
                 grain=2),
    "lars": Look((0.63, 0.40, 0.31), (0.46, 0.20, 0.17), (0.22, 0.17, 0.12), (0.20, 0.30, 0.38), stubble=0.3,
                 blush=1.4, hairline=8, temples=9, cut="short", grain=3),
    "rosa": Look((0.60, 0.37, 0.28), (0.45, 0.18, 0.16), (0.16, 0.075, 0.035), (0.16, 0.22, 0.12), brow_height=7.2,
                 brow_arch=1.1, lashes=1.0, cut="short", moles=0.3, grain=4),
    "mei": Look((0.60, 0.41, 0.28), (0.46, 0.18, 0.15), (0.025, 0.018, 0.016), (0.08, 0.045, 0.025), brow_arch=0.6,
                cut="short", blotches=0.7, grain=5),
}  # fmt: skip
LIGHT = np.array([0.68, 0.475, 0.385])  # the lightest skin, and what melanin takes from it
MELANIN = np.array([1.32, 1.62, 1.92])
LIP_OF_LIGHT, LIP_OF_DARK = np.array([0.82, 0.46, 0.52]), np.array([0.94, 0.66, 0.88])  # times the skin
HAIR = np.array([[0.018, 0.014, 0.012], [0.05, 0.03, 0.02], [0.11, 0.065, 0.04], [0.26, 0.17, 0.095],
                 [0.19, 0.075, 0.03], [0.13, 0.123, 0.115]])  # black, dark brown, brown, blond, red, grey  # fmt: skip
IRIS = np.array([[0.07, 0.04, 0.025], [0.17, 0.095, 0.045], [0.24, 0.19, 0.09], [0.17, 0.24, 0.15],
                 [0.20, 0.29, 0.38], [0.30, 0.33, 0.34]])  # black, brown, hazel, green, blue, grey  # fmt: skip


def draw_look(seed: int) -> Look:
    """A plausible look: skin from light to dark in equal shares, hair and eyes that go with it."""
    rng = np.random.default_rng([seed, 68])
    melanin = float(rng.uniform(0.0, 0.92))
    fair = max(1 - 2.2 * melanin, 0.0)
    skin = LIGHT * np.exp(-melanin * MELANIN) * (1 + 0.04 * rng.normal(size=3) * [0.5, 1, 1])
    lips = skin * (LIP_OF_LIGHT + min(1.2 * melanin, 1) * (LIP_OF_DARK - LIP_OF_LIGHT))
    shaves = rng.random() < 0.5
    colored = not shaves and rng.random() < 0.4
    lips = lips * ([0.95, 0.62, 0.68] if colored else 1 - 0.12 * rng.random(3) * [0.3, 1, 1])
    hair = HAIR[rng.choice(6, p=_shares([1.2, 1.2, 1.0 * (fair > 0), 1.2 * fair, 0.5 * fair, 0.35]))]
    iris = IRIS[rng.choice(6, p=_shares([0.3 + melanin, 1.2, 0.6 * (fair > 0), 0.5 * fair, 1.2 * fair, 0.4 * fair]))]
    drawn_back = shaves and rng.random() < 0.35
    return Look(
        skin=_color(skin), lips=_color(lips), hair=_color(hair * rng.uniform(0.8, 1.2)),
        iris=_color(iris * rng.uniform(0.8, 1.2)),
        blush=float(rng.uniform(0.5, 1.6)), blotches=float(rng.uniform(0.6, 1.5)), shade=float(rng.uniform(0.5, 1.5)),
        brow_height=float(rng.uniform(7.4, 10.5) if shaves else rng.uniform(5.2, 8.0)),
        brow_arch=float(rng.uniform(0.3, 0.9) if shaves else rng.uniform(0.8, 1.5)),
        brow_density=float(rng.uniform(0.7, 1.0)),
        lashes=float(rng.uniform(0.6, 0.85) if shaves else rng.uniform(0.85, 1.0)),
        stubble=float(rng.uniform(0.1, 1.0) ** 1.5) if shaves else 0.0,
        freckles=float(max(rng.uniform(-1.2, 1.0), 0.0) * (0.3 + 0.7 * fair) * (melanin < 0.5)),
        moles=float(rng.uniform(0.0, 0.4)),
        cut=str(rng.choice(["bald", "buzz", "short"], p=[0.25, 0.3, 0.45] if shaves else [0.05, 0.2, 0.75])),
        hairline=float(rng.uniform(4, 16) if drawn_back else rng.uniform(-5, 5)),
        temples=float(rng.uniform(4, 16) if drawn_back else rng.uniform(-3, 4)),
        grain=int(rng.integers(1 << 20)),
    )  # fmt: skip


def _shares(weights: list[float]) -> np.ndarray:
    return np.array(weights) / np.sum(weights)


def _color(values: np.ndarray) -> Color:
    red, green, blue = (round(float(v), 4) for v in np.clip(values, 0.008, 0.95))
    return red, green, blue
