"""Hyperparameters with which a training takes seconds: small networks, few updates, held actions that touch."""


def hyperparameters(env, **more):
    """A file's text for an id without namespace, with further lines."""
    return "\n".join([f"{env}:", *(f"  {key}: {value}" for key, value in {**SMALL, **more}.items()), ""])


SMALL = {
    "batch_size": 16,
    "policy_kwargs": '"dict(net_arch=[16, 8])"',
    "train_freq": "[1, episode]",
    "gradient_steps": 30,
    "learning_starts": 50,
    "hold": 7,
    "noise_type": "normal",
    "noise_std": 0.1,
}
