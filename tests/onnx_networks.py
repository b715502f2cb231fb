"""Small networks in ONNX, and images that they understand."""

import json

import numpy as np

DESCRIPTION = {
    "classes": ["background", "Middle line", "Side line top"],
    "input_size": [64, 36],
    "mean": [0.5, 0.25, 0.0],
    "std": [0.25, 0.5, 1.0],
    "channels": "RGB",
}


def write_network(folder, *, outputs=3, batch="N", size=(64, 36), kind=None):
    """A network that tells colours apart at half its input's size: the second class is red, the third one blue."""
    import onnx

    helper, real = onnx.helper, onnx.TensorProto.FLOAT
    weight = np.zeros((outputs, 3, 1, 1), np.float32)
    bias = np.zeros(outputs, np.float32)
    if outputs == 3:
        # of values that mean and std have changed: 8 (r - 1/2) and 8 (b - 1/2), in 0..1
        weight[1, 0], weight[2, 2] = 8.0 * 0.25, 8.0
        bias[:] = 0.0, 0.0, -4.0
    graph = helper.make_graph(
        [
            helper.make_node("AveragePool", ["image"], ["half"], kernel_shape=[2, 2], strides=[2, 2]),
            helper.make_node("Conv", ["half", "weight", "bias"], ["logits"]),
        ],
        "colours",
        [helper.make_tensor_value_info("image", kind or real, [batch, 3, size[1], size[0]])],
        [helper.make_tensor_value_info("logits", real, None)],
        [onnx.numpy_helper.from_array(weight, "weight"), onnx.numpy_helper.from_array(bias, "bias")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    path = folder / "colours.onnx"
    onnx.save(model, path)
    path.with_suffix(".json").write_text(json.dumps(DESCRIPTION))
    return path


def coloured(size):
    """A red vertical band and a blue horizontal one, a quarter of the image from the left and from the top."""
    image = np.zeros((size[1], size[0], 3), np.uint8)
    x, y = size[0] // 4, size[1] // 4
    half = size[0] // 32
    image[:, x - half : x + half, 2] = 255
    image[y - half : y + half, :, :] = (255, 0, 0)
    return image, (x - 0.5, y - 0.5)
