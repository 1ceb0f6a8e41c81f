#!/usr/bin/env python3
"""Writes what OpenCLIP and Hugging Face compute with weights given by a formula, for `crates/models/tests/it/clip.rs`.

    pip install torch torchvision open_clip_torch timm transformers     # in a virtual environment
    python tools/make_clip_test_data.py crates/models/tests/data/clip

Weights, names and shapes: as in `make_sam2_test_data.py`. Each network is a miniature with the structure of a published
one, and every file has its configuration, its parameters' names and shapes, and the embeddings of images and texts, which
are normalised. Tokens are those of OpenCLIP's `SimpleTokenizer`, for texts that `ftfy` and `html` leave as they are.
"""

import html
import json
import math
import random
import sys
from pathlib import Path

import ftfy
import numpy
import open_clip
import torch
from open_clip.tokenizer import SimpleTokenizer
from timm.models.eva import Eva
from transformers import CLIPConfig, CLIPModel

TEXTS = [
    "a photo of a mug",
    "the small red one",
    "",
    "a wooden chair, 3 legs (broken?)",
    "Zimmerpflanze's übergroß",
    "🪴",
]
IMAGES = 3


def hash_of(name):
    value = 0xCBF29CE484222325
    for byte in name.encode():
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


def uniform(name, count):
    """Numbers of the sequence `name`, in [-1, 1): SplitMix64 of its FNV-1a hash plus the index."""
    z = numpy.uint64((hash_of(name) + 0x9E3779B97F4A7C15) % 2**64) + numpy.arange(count, dtype=numpy.uint64)
    z = (z ^ (z >> numpy.uint64(30))) * numpy.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> numpy.uint64(27))) * numpy.uint64(0x94D049BB133111EB)
    z = z ^ (z >> numpy.uint64(31))
    return (z >> numpy.uint64(11)).astype(numpy.float64) / 2**53 * 2 - 1


def formula(name, shape):
    """A parameter, float32."""
    leaf = name.rsplit(".", 1)[-1]
    if leaf in ("weight", "in_proj_weight") and len(shape) >= 2 and "embedding" not in name:
        offset, scale = 0, math.sqrt(3 / math.prod(shape[1:]))
    elif leaf in ("proj", "text_projection"):
        offset, scale = 0, math.sqrt(3 / shape[0])
    elif leaf == "weight" and len(shape) == 1:
        offset, scale = 1, 0.1
    elif "bias" in leaf:
        offset, scale = 0, 0.05
    else:
        offset, scale = 0, 0.5
    values = offset + scale * uniform(name, math.prod(shape))
    return torch.from_numpy(values.astype(numpy.float32).reshape(shape))


def set_formula(model):
    """Sets the parameters; returns their names and shapes."""
    tensors = {name: tensor for name, tensor in model.state_dict().items() if "position_ids" not in name}
    for name, tensor in tensors.items():
        if tensor.dim() > 0:
            tensor.copy_(formula(name, tuple(tensor.shape)))
    return [[name, list(tensor.shape)] for name, tensor in tensors.items()]


def pixels(size):
    """Images, `[IMAGES, size, size, 3]`."""
    values = uniform("pixels", IMAGES * size * size * 3)
    return ((values + 1) * 127.999).astype(numpy.uint8).reshape(IMAGES, size, size, 3)


def normalised(size, mean, deviation):
    images = torch.from_numpy(pixels(size)).float() / 255
    return ((images - torch.tensor(mean)) / torch.tensor(deviation)).permute(0, 3, 1, 2)


OPENAI = [[0.48145466, 0.4578275, 0.40821073], [0.26862954, 0.26130258, 0.27577711]]
TEXT = {"context_length": 20, "vocab_size": 49408, "width": 24, "heads": 3, "layers": 2}


def open_clip_network(quick_gelu, custom_text):
    config = {
        "embed_dim": 20,
        "quick_gelu": quick_gelu,
        "vision_cfg": {"image_size": 48, "layers": 3, "width": 32, "head_width": 16, "patch_size": 16},
        "text_cfg": TEXT,
    }
    kind = open_clip.CustomTextCLIP if custom_text else open_clip.CLIP
    model = kind(**config).eval()
    return config, model, lambda: model.encode_image(normalised(48, *OPENAI))


def perception_encoder():
    config = {
        "embed_dim": 20,
        "vision_cfg": {"image_size": 64, "head_width": 16, "attn_pool_num_heads": 4},
        "text_cfg": TEXT,
    }
    small = {"image_size": 64, "layers": 1, "width": 32, "head_width": 16, "patch_size": 16}
    text = {"embed_dim": 20, "vision_cfg": small, "text_cfg": TEXT}
    model = open_clip.CustomTextCLIP(**text)
    del model.visual
    model.visual = torch.nn.Module()
    # As in timm's `vit_pe_core_small_patch16_384`, but smaller.
    model.visual.trunk = Eva(
        img_size=64,
        patch_size=16,
        num_classes=20,
        embed_dim=48,
        depth=2,
        num_heads=3,
        mlp_ratio=4.0,
        global_pool="map",
        attn_type="rope",
        use_pre_transformer_norm=True,
        use_rot_pos_emb=True,
        ref_feat_shape=(4, 4),
        rope_grid_offset=1.0,
        rope_grid_indexing="xy",
        attn_pool_num_heads=4,
        attn_pool_mlp_ratio=4.0,
        norm_layer=lambda *sizes, **options: torch.nn.LayerNorm(*sizes, eps=1e-5, **options),
    )
    model.eval()
    return config, model, lambda: model.visual.trunk(normalised(64, [0.5] * 3, [0.5] * 3))


def hugging_face(activation):
    sizes = {"hidden_size": 32, "intermediate_size": 80, "num_hidden_layers": 2, "num_attention_heads": 4}
    vision = sizes | {"image_size": 48, "patch_size": 12, "hidden_act": activation}
    text = sizes | {"vocab_size": 49408, "max_position_embeddings": 20, "hidden_act": activation, "eos_token_id": 49407}
    config = {"projection_dim": 20, "vision_config": vision, "text_config": text}
    model = CLIPModel(CLIPConfig(**config)).eval()

    def images():
        return model.visual_projection(model.vision_model(normalised(48, *OPENAI)).pooler_output)

    return config, model, images


def write(path, config, model, images, texts):
    with torch.no_grad():
        tensors = set_formula(model)
        unit = torch.nn.functional.normalize
        data = {
            "config": config,
            "tensors": tensors,
            "texts": TEXTS,
            "image_embeddings": [row.tolist() for row in unit(images(), dim=-1)],
            "text_embeddings": [row.tolist() for row in unit(texts(model), dim=-1)],
        }
    path.write_text(json.dumps(data) + "\n")


def odd_texts():
    """A thousand texts of words, digits, marks, and letters of many scripts."""
    chance = random.Random(5)
    words = (
        ["mug", "chair", "Sofa's", "table-lamp", "o'clock", "they'll", "TV", "4K", "1990s", "naïve", "Übergröße", "façade", "don't", "co-op", "x²", "½", "e.g.", "Ⅳ"]
    )
    scripts = [
        "абвгд ежз",
        "日本語のマグ",
        "杯子椅子",
        "한국어",
        "αβγς ΔΣ",
        "עברית",
        "हिन्दी",
        "ภาษา",
        "العربية",
        "ქართული",
        "🪑🛋️👩‍🔬🏽",
    ]
    marks = [
        "!",
        "??",
        "...",
        "--",
        "()",
        "[x]",
        "@#$%",
        "&",
        "*",
        "/",
        "\\",
        "'",
        '"',
        "_",
        "~",
        "|",
        "=",
        "<3",
        ">",
        "'s",
        "’",
    ]
    space = [" ", "  ", "\t", "\n", ""]
    texts = set()
    while len(texts) < 1000:
        parts = []
        for _ in range(chance.randint(1, 9)):
            pick = chance.random()
            if pick < 0.45:
                parts.append(chance.choice(words))
            elif pick < 0.6:
                start = chance.choice(scripts)
                parts.append(start[chance.randint(0, len(start) - 1) :])
            elif pick < 0.8:
                parts.append(chance.choice(marks))
            elif pick < 0.9:
                parts.append(str(chance.randint(0, 10**6)))
            else:
                parts.append(
                    "".join(chr(chance.choice([chance.randint(33, 126), chance.randint(0xC0, 0x24F)])) for _ in "abc")
                )
            parts.append(chance.choice(space))
        text = "".join(parts)
        straight = text.replace("’", "'")
        if ftfy.fix_text(text) == straight and html.unescape(straight) == straight:
            texts.add(text)
    return sorted(texts)


def main(folder):
    folder.mkdir(parents=True, exist_ok=True)
    tokenizer = SimpleTokenizer(context_length=20)
    tokens = tokenizer(TEXTS)

    def open_clip_texts(model):
        return model.encode_text(tokens)

    def hugging_face_texts(model):
        # Padded by the token of the end, as its own tokenizer does.
        padded = tokens.where(tokens > 0, 49407)
        return model.text_projection(model.text_model(padded).pooler_output)

    write(folder / "open_clip.json", *open_clip_network(False, False), open_clip_texts)
    write(folder / "open_clip_quick.json", *open_clip_network(True, True), open_clip_texts)
    write(folder / "perception_encoder.json", *perception_encoder(), open_clip_texts)
    write(folder / "hugging_face.json", *hugging_face("quick_gelu"), hugging_face_texts)
    write(folder / "hugging_face_gelu.json", *hugging_face("gelu"), hugging_face_texts)
    texts = odd_texts()
    ids = [row[row > 0].tolist() for row in SimpleTokenizer(context_length=77)(texts)]
    lines = [json.dumps([text, row]) for text, row in zip(texts, ids, strict=True)]
    (folder / "tokens.jsonl").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
