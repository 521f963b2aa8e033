"""Mean of the weights of several runs that started from the same ones, each with a --seed of its own.

Runs that part late lie in one valley of the loss. Their mean is about as good as the best of them on
what they were trained for, and better on what none was: what each learnt of its own scenes alone
averages out.
"""
import argparse
import sys

import torch

import model as dvsm


def average(paths):
    """The mean of model files of one configuration: weights by name, and the configuration."""
    nets = [dvsm.load(path) for path in paths]
    for path, net in zip(paths, nets):
        if net.config != nets[0].config:
            raise SystemExit(f"average: {path} is {net.config}, {paths[0]} {nets[0].config}: give "
                             "files of runs from the same weights")
    columns = zip(*(net.named_parameters() for net in nets))
    weights = {column[0][0]: torch.stack([weight.detach() for _, weight in column]).mean(0)
               for column in columns}
    return weights, nets[0].config


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", help="model file to write")
    parser.add_argument("models", nargs="+", help="model files, as runs leave them")
    args = parser.parse_args()
    try:
        dvsm.save(args.out, *average(args.models))
    except (OSError, ValueError) as fault:
        raise SystemExit(f"average: {fault}") from fault
    print(f"average: {args.out}: the mean of {len(args.models)} files")
    return 0


if __name__ == "__main__":
    sys.exit(main())
