"""Names for objects, from a network of yours: which of some words does the best picture of an object look like?

    pip install open_clip_torch
    python name_objects.py SCENE MODEL WEIGHTS

MODEL and WEIGHTS are open_clip's, e.g. ``ViT-B-32 laion2b_s34b_b79k`` (it downloads them) or ``ViT-B-32 file.pt``.
Without them a stand-in names colours.
"""

import sys
from typing import Protocol

import numpy as np
import splatseg as ss
from numpy.typing import NDArray

WORDS = ("mug", "bottle", "book", "chair", "table", "sofa", "cupboard", "lamp", "plant", "screen", "wall", "floor")
COLORS = {"red": (200, 60, 60), "green": (60, 160, 70), "blue": (60, 90, 190), "yellow": (210, 190, 60)}
COLORS |= {"white": (225, 225, 225), "grey": (130, 130, 130), "black": (30, 30, 30), "brown": (120, 80, 50)}


Vector = NDArray[np.floating]


class Network(Protocol):
    """Embeds words and pictures as vectors of one space."""

    @property
    def words(self) -> tuple[str, ...]: ...

    def text(self, word: str) -> Vector: ...

    def picture(self, rgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> Vector: ...


class Colors:
    """Embeds colours."""

    words = tuple(COLORS)

    def text(self, word: str) -> Vector:
        return np.subtract(COLORS[word], 128) / 128

    def picture(self, rgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> Vector:
        return np.asarray((rgb[mask].mean(axis=0) - 128) / 128)


class OpenClip:
    """Embeds words and pictures with CLIP."""

    words = WORDS

    def __init__(self, model: str, weights: str) -> None:
        import open_clip

        self.model, self.preprocess = open_clip.create_model_from_pretrained(model, pretrained=weights)
        self.tokens = open_clip.get_tokenizer(model)
        self.model.eval()

    def text(self, word: str) -> Vector:
        embedding = self.model.encode_text(self.tokens([f"a photo of a {word}"]), normalize=True)
        return np.asarray(embedding[0].detach().numpy())

    def picture(self, rgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> Vector:
        from PIL import Image

        pixels = self.preprocess(Image.fromarray(rgb)).unsqueeze(0)
        return np.asarray(self.model.encode_image(pixels, normalize=True)[0].detach().numpy())


def main(scene: str = "synthetic:frames=12,width=96,height=72,objects=6", *clip: str) -> ss.Pipeline:
    network: Network = OpenClip(*clip) if clip else Colors()
    texts = np.stack([network.text(word) for word in network.words])

    def name(rgb: NDArray[np.uint8], mask: NDArray[np.bool_], thing: ss.Object) -> tuple[str, Vector]:
        embedding = network.picture(rgb, mask)
        return network.words[int(np.linalg.norm(texts - embedding, axis=1).argmin())], embedding

    pipeline = ss.FastSamSplat(keep_views=True)
    for _ in pipeline.run(scene):
        pass
    print(pipeline.name_objects(name), "objects named")
    for found in pipeline.find(texts[0], top=3):
        print(f"{found.object.id} {found.object.label}: {found.similarity or 0:.2f} like {network.words[0]}")
    return pipeline


if __name__ == "__main__":
    main(*sys.argv[1:])
