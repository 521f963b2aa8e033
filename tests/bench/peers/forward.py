"""The network once, over the operations of a peer: norm, linear, head_norm, attention, gelu, add.

x is [batch, tokens, D]; a batch is a view within a view's attention and 1 across views.
"""


def mix(ops, half, x, query, key, value):
    """x += Wo attention; x += MLP."""
    x = ops.add(x, ops.linear(half + ".out", ops.attention(query, key, value)))
    hidden = ops.gelu(ops.linear(half + "_mlp.up", ops.norm(half + "_mlp_norm", x)))
    return ops.add(x, ops.linear(half + "_mlp.down", hidden))


def within(ops, block, x):
    half = block + ".intra"
    query, key, value = ops.split(ops.linear(half + ".qkv", ops.norm(half + "_norm", x)), 3)
    return mix(ops, half, x, ops.head_norm(half + ".q_norm", query),
               ops.head_norm(half + ".k_norm", key), value)


def reconstruct(ops, layers, ray, rgb):
    """[(key, value)] of each block, [1, views tokens, D]."""
    x = ops.norm("embed_norm", ops.add(ops.linear("patch_ray", ray), ops.linear("patch_rgb", rgb)))
    cache = []
    for layer in range(layers):
        half = f"blocks.{layer}.cross"
        x = ops.join_views(within(ops, f"blocks.{layer}", x))
        normed = ops.norm(half + "_norm", x)
        key, value = ops.split(ops.linear(half + ".key_value", normed), 2)
        key = ops.head_norm(half + ".k_norm", key)
        cache.append((key, value))
        if layer + 1 < layers:
            query = ops.head_norm(half + ".q_norm", ops.linear(half + ".query", normed))
            x = ops.part_views(mix(ops, half, x, query, key, value))
    return cache


def render(ops, ray, cache):
    """[1, tokens, 3 q q]."""
    x = ops.norm("embed_norm", ops.linear("patch_ray", ray))
    for layer, (key, value) in enumerate(cache):
        half = f"blocks.{layer}.cross"
        x = within(ops, f"blocks.{layer}", x)
        query = ops.linear(half + ".query", ops.norm(half + "_norm", x))
        x = mix(ops, half, x, ops.head_norm(half + ".q_norm", query), key, value)
    return ops.linear("to_rgb", ops.norm("final_norm", x))


def split_cross(weights):
    """The weights with each cross-view qkv cut into what rendering and the cache need."""
    cut = dict(weights)
    for name, numbers in weights.items():
        if name.endswith(".cross.qkv"):
            dim = numbers.shape[1]
            cut[name.replace("qkv", "query")] = numbers[:dim]
            cut[name.replace("qkv", "key_value")] = numbers[dim:]
            del cut[name]
    return cut
