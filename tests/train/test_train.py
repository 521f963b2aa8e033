"""Tests of the trainer: python3 tests/train/test_train.py (exit 77 without PyTorch)."""
import contextlib
import json
import os
import sys
import tempfile
import types
import unittest
import unittest.mock

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "..", "train"))

try:
    import torch
except ImportError:
    torch = None

if torch:
    import ablate
    import average
    import checkpoint
    import checks
    import data
    import fast
    import geometry
    import losses
    import model as dvsm
    import optim
    import safetensors_io
    import source
    import train

TINY = {"dim": 32, "heads": 2, "layers": 2, "patch": 4}
RECIPE = {
    "model": TINY, "optimiser": "adamw", "lr": 1e-3, "weight_decay": 0.05, "warmup_steps": 2,
    "schedule": "wsd", "clip": 1.0, "average_decay": 0.99,
    "stages": [{"mix": {"16/4/4": 0.5, "16/8/4": 0.5}, "context": {"1": 0.5, "3": 0.5},
                "views": 5, "tokens": 256}],
}


class Smooth:
    """A generator of easy scenes: colour is a function of the ray."""

    def batch(self, seed, scenes, views, size, options=0):
        random = torch.Generator().manual_seed(seed)
        poses = torch.eye(4).repeat(scenes, views, 1, 1)
        poses[..., :3, 3] = torch.randn(scenes, views, 3, generator=random)
        tone = torch.rand(scenes, 1, 1, 1, 3, generator=random)
        pictures = (tone + 0.1 * poses[..., None, None, :3, 3]).clamp(0, 1)
        pictures = pictures.expand(-1, -1, size[1], size[0], -1).contiguous()
        intrinsics = torch.tensor([size[0], size[0], size[0] / 2 - 0.5, size[1] / 2 - 0.5])
        return pictures, poses, intrinsics.repeat(scenes, views, 1)


class Counting(Smooth):
    calls = 0

    def batch(self, *arguments):
        self.calls += 1
        return super().batch(*arguments)


class Broken(Smooth):
    def batch(self, seed, *arguments):
        if seed >= data.FIRST_TRAINING_SEED + 4 * 4096:
            raise MemoryError("no memory")
        return super().batch(seed, *arguments)


def run_steps(run, generator, count):
    loss_of, losses_seen = losses.Loss(), []
    for _ in range(count):
        step = data.plan(RECIPE, 0, run.step)
        batch = data.draw(generator, step)
        lr = optim.learning_rate(run.recipe, run.step, 0.0)
        losses_seen.append(run.train_step(step, batch, loss_of, lr)[0].item())
        run.step += 1
    return losses_seen


def make_run(folder, recipe=None, **extra):
    args = types.SimpleNamespace(seed=0, init=None, out=folder, gradient_checkpointing=False,
                                 checkpoint_mib=None, plain=True)
    vars(args).update(extra)
    return train.Run(args, recipe or RECIPE, train.Place())


@unittest.skipUnless(torch, "PyTorch is not installed")
class Trainer(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        torch.manual_seed(1)

    def path(self, name):
        return os.path.join(self.folder.name, name)

    def test_exported_weights_come_back_the_same(self):
        net = dvsm.Dvsm(dvsm.Config(**TINY))
        weights = dict(net.named_parameters())
        dvsm.save(self.path("m.safetensors"), weights, net.config, torch.float32)
        again = dvsm.load(self.path("m.safetensors"))
        self.assertEqual(again.config, net.config)
        for name, weight in net.named_parameters():
            self.assertTrue(torch.equal(weight, dict(again.named_parameters())[name]), name)

    def test_models_are_averaged(self):
        paths = [self.path(f"{i}.safetensors") for i in range(3)]
        nets = [dvsm.Dvsm(dvsm.Config(**TINY)) for _ in paths]
        for path, net in zip(paths, nets):
            dvsm.save(path, dict(net.named_parameters()), net.config, torch.float32)
        weights, config = average.average(paths)
        self.assertEqual(config, nets[0].config)
        for name, weight in weights.items():
            want = sum(dict(net.named_parameters())[name].detach() for net in nets) / 3
            self.assertLess((weight - want).abs().max().item(), 1e-6)
        other = dvsm.Dvsm(dvsm.Config(**dict(TINY, layers=1)))
        dvsm.save(paths[1], dict(other.named_parameters()), other.config)
        with self.assertRaisesRegex(SystemExit, "1.safetensors is .*: give files of runs"):
            average.average(paths)

    def test_a_damaged_model_file_is_refused_by_name(self):
        net = dvsm.Dvsm(dvsm.Config(**TINY))
        weights = dict(net.named_parameters())
        dvsm.save(self.path("m.safetensors"), weights, net.config)
        with open(self.path("m.safetensors"), "rb") as file:
            whole = file.read()
        with open(self.path("cut.safetensors"), "wb") as file:
            file.write(whole[:-100])
        with self.assertRaisesRegex(ValueError, "to_rgb.weight"):
            dvsm.load(self.path("cut.safetensors"))
        weights["final_norm.weight"].data[0] = float("nan")
        with self.assertRaisesRegex(ValueError, "final_norm.weight"):
            dvsm.save(self.path("nan.safetensors"), weights, net.config)

    def test_resume_continues_the_same_losses(self):
        for kind in ("adamw", "muon"):
            with self.subTest(kind):
                recipe = dict(RECIPE, optimiser=kind)
                run = make_run(self.path(kind), recipe)
                run_steps(run, Smooth(), 4)
                run.save()
                want = run_steps(run, Smooth(), 4)
                got = run_steps(make_run(self.path(kind), recipe), Smooth(), 4)
                self.assertEqual(want, got)

    def test_resume_from_a_compact_checkpoint_stays_close(self):
        run = make_run(self.path("run"))
        run_steps(run, Smooth(), 6)
        exact = len(safetensors_io.pack(checkpoint.encode(run.state(), "exact")))
        compact = len(safetensors_io.pack(checkpoint.encode(run.state(), "compact")))
        self.assertLess(compact, 0.5 * exact)
        run.args.checkpoint_mib = compact * 1.05 / 2 ** 20
        run.save()
        with open(os.path.join(run.folder, "manifest.json"), encoding="utf-8") as file:
            self.assertEqual(json.load(file)["level"], "compact")
        want = run_steps(run, Smooth(), 3)
        got = run_steps(make_run(self.path("run")), Smooth(), 3)
        for a, b in zip(want, got):
            self.assertAlmostEqual(a, b, delta=0.01 * abs(a))

    def test_a_damaged_checkpoint_is_refused(self):
        run = make_run(self.path("run"))
        run.save()
        with open(os.path.join(run.folder, "piece-000.bin"), "r+b") as file:
            file.seek(5000)
            file.write(b"\xff")
        with self.assertRaisesRegex(ValueError, "checksum"):
            make_run(self.path("run"))

    def test_training_lowers_the_loss(self):
        seen = run_steps(make_run(self.path("run"), dict(RECIPE, lr=5e-3)), Smooth(), 60)
        self.assertLess(sum(seen[-5:]), 0.5 * sum(seen[:5]))

    def test_gradient_checkpointing_changes_no_loss(self):
        plain = run_steps(make_run(self.path("a")), Smooth(), 3)
        frugal = run_steps(make_run(self.path("b"), gradient_checkpointing=True), Smooth(), 3)
        for a, b in zip(plain, frugal):
            self.assertAlmostEqual(a, b, places=6)

    def test_a_step_away_from_the_cpu_mixes_no_devices(self):
        # Tensors on `meta` have shapes and no numbers: a tensor of the CPU among them is refused,
        # as it would be on a GPU.
        meta, loss_of = torch.device("meta"), losses.Loss()
        net = dvsm.Dvsm(dvsm.Config(**TINY)).to(meta)
        matrices = [weight for weight in net.blocks.parameters() if weight.dim() == 2]
        optimiser = optim.Muon(matrices, 1e-3, 0.05)
        with unittest.mock.patch("torch.autocast", lambda *_, **__: contextlib.nullcontext()):
            for size, patches in (((16, 16), (4, 4)), ((24, 16), (8, 4)), ((16, 32), (4, 8))):
                batch = tuple(t.to(meta) for t in Smooth().batch(3, 2, 5, size))
                pictures, poses, intrinsics = batch
                got = net(pictures[:, :3], poses, intrinsics, size, patches)
                loss_of(got, pictures[:, 3:])[0].backward()
            here = Smooth().batch(3, 2, 5, size)[0]
            with self.assertRaisesRegex(RuntimeError, "device|meta"):
                net(here[:, :3], poses, intrinsics, size, patches)
        optimiser.step()
        optim.Average(net, 0.99).update(net)

    def test_moving_turning_and_scaling_the_rig_changes_no_pixel(self):
        net = dvsm.Dvsm(dvsm.Config(**TINY)).double()
        pictures, poses, intrinsics = (t.double() for t in Smooth().batch(3, 1, 4, (16, 12)))
        turn = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64))[0]
        turn = turn * torch.linalg.det(turn)
        moved = poses.clone()
        moved[..., :3, :3] = turn @ poses[..., :3, :3]
        moved[..., :3, 3] = 7.5 * (poses[..., :3, 3] @ turn.T) + torch.tensor([3.0, -2, 9])
        want = net(pictures[:, :3], poses, intrinsics, (16, 12), (4, 4))
        got = net(pictures[:, :3], moved, intrinsics, (16, 12), (4, 4))
        self.assertLess((want - got).abs().max().item(), 1e-9)

    def test_resampling_keeps_a_ramp_and_the_mean(self):
        ramp = torch.arange(12, dtype=torch.float64).view(1, 12, 1).expand(8, 12, 3)
        small = geometry.resample(ramp, (5, 3))
        self.assertAlmostEqual(small.mean().item(), ramp.mean().item(), places=12)
        self.assertAlmostEqual(small[0, 0, 0].item(), (0 + 1 + 0.4 * 2) / 2.4, places=12)
        self.assertAlmostEqual(geometry.resample(ramp, (24, 8))[0, 5, 0].item(), 2.25, places=12)

    def test_a_recipe_changes_what_it_says_of_its_base(self):
        recipes = os.path.join(HERE, "..", "..", "train", "recipes")
        whole, slot = (data.load_recipe(os.path.join(recipes, name))
                       for name in ("gpu.json", "gpu-slot.json"))
        self.assertEqual([stage.get("until_step") for stage in slot["stages"]], [2500, 4500, None])
        for stage, other in zip(whole["stages"], slot["stages"]):
            self.assertEqual({**stage, "until_step": None}, {**other, "until_step": None})
        self.assertEqual({**whole, "average_decay": 0, "stages": 0},
                         {**slot, "average_decay": 0, "stages": 0})
        short = self.path("short.json")
        with open(short, "w", encoding="utf-8") as file:
            json.dump({"base": os.path.join(recipes, "gpu.json"), "stages": [{}]}, file)
        with self.assertRaisesRegex(SystemExit, "short.json: 1 stages, its base has 3"):
            data.load_recipe(short)

    def test_steps_follow_from_seed_and_number_alone(self):
        plans = [data.plan(RECIPE, 5, n) for n in range(50)]
        self.assertEqual(plans, [data.plan(RECIPE, 5, n) for n in range(50)])
        seeds = [p.seed + i for p in plans for i in range(p.scenes())]
        self.assertEqual(len(seeds), len(set(seeds)))
        self.assertEqual({p.context for p in plans}, {1, 3})
        two = [data.plan(RECIPE, 5, 9, rank, 2) for rank in (0, 1)]
        self.assertNotEqual(two[0].seed, two[1].seed)
        self.assertEqual(two[0].size, two[1].size)
        self.assertEqual(two[0].scenes(), two[1].scenes())

    def test_reused_scenes_are_drawn_once_and_seen_in_another_order(self):
        stage = dict(RECIPE["stages"][0], reuse=3)
        plans = [data.plan(dict(RECIPE, stages=[stage]), 5, n) for n in range(12)]
        generator = Counting()
        loader = data.Loader(generator, iter(plans + [plans[0]] * 40))
        got = [loader.get() for _ in range(12)]
        loader.close()
        self.assertEqual([step for step, _ in got], plans)
        self.assertLessEqual(generator.calls, 4 + 6)
        self.assertIs(got[0][1], got[2][1])
        self.assertEqual(len({p.seed for p in plans}), 4)
        self.assertGreater(len({p.order for p in plans}), 8)

    def test_loader_hands_out_steps_in_order_and_shows_a_fault(self):
        steps = [data.plan(RECIPE, 0, n) for n in range(30)]
        loader = data.Loader(Broken(), iter(steps), threads=2)
        self.assertEqual([loader.get()[0] for _ in range(4)], steps[:4])
        with self.assertRaisesRegex(RuntimeError, "generator"):
            loader.get()
        loader.close()

    def test_lone_views_and_two_stages_change_what_they_say_and_nothing_else(self):
        config = dvsm.Config(**TINY)
        pictures, poses, intrinsics = Smooth().batch(3, 1, 4, (16, 12))
        first = (pictures[:, :3], poses, intrinsics, (16, 12), (4, 4))
        other = pictures[:, :3].clone()
        other[:, 1] += 0.5
        nets = {}
        for kind in (dvsm.Dvsm, ablate.LoneViews, ablate.TwoStages):
            torch.manual_seed(7)
            nets[kind] = kind(config)
        want = nets[dvsm.Dvsm](*first)
        self.assertTrue(torch.equal(nets[ablate.TwoStages](*first), want))
        with torch.no_grad():
            nets[ablate.TwoStages].render_blocks[0].intra.out.weight.mul_(3)
        self.assertFalse(torch.equal(nets[ablate.TwoStages](*first), want))

        def keys(net, seen):
            rotation, centre = geometry.normalise_poses(poses, 3)
            return net.reconstruct(seen, (rotation[:, :3], centre[:, :3], intrinsics[:, :3]), 4)

        n = keys(nets[dvsm.Dvsm], other)[0][0].shape[2] // 3
        for kind, alone in ((dvsm.Dvsm, False), (ablate.LoneViews, True)):
            a, b = (keys(nets[kind], seen)[1][0][:, :, :n] for seen in (pictures[:, :3], other))
            self.assertEqual(torch.equal(a, b), alone)
        lone = keys(nets[ablate.LoneViews], pictures[:, :3])[0][0]
        self.assertLess((lone - keys(nets[dvsm.Dvsm], pictures[:, :3])[0][0]).abs().max(), 1e-5)

    def gradients(self, net, blocks, views, patches, exact=False):
        """(pictures, gradients by name) of a network whose blocks are PyTorch's or `blocks`."""
        pictures, poses, intrinsics = Smooth().batch(3, 2, views + 3, (24, 20))
        torch.manual_seed(5)
        pictures = torch.rand_like(pictures)
        net.fast = blocks
        net.zero_grad()
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=not exact):
            got = net(pictures[:, :views], poses, intrinsics, (24, 20), patches)
        (got.float() - pictures[:, views:]).square().mean().backward()
        return got.detach(), {name: weight.grad for name, weight in net.named_parameters()
                              if weight.grad is not None}

    def libraries(self):
        """Each build of the blocks that this processor runs."""
        libraries = list(fast.libraries())
        if not libraries:
            self.skipTest("no AVX-512, or the blocks in C were not built")
        return {os.path.basename(library.path): library for library in libraries}

    def test_blocks_in_c_have_the_gradients_of_pytorch(self):
        config, libraries = dvsm.Config(dim=128, heads=2, layers=2, patch=4), self.libraries()
        for kind in (dvsm.Dvsm, ablate.TwoStages, ablate.LoneViews):
            net = kind(config)
            with torch.no_grad():  # scores and norms that are not trivial
                for weight in net.parameters():
                    weight.add_(torch.randn_like(weight) * (0.1 if weight.dim() == 1 else 0.03))
            for views, patches in ((1, (4, 4)), (3, (4, 8)), (4, (8, 4))):
                want, slopes = self.gradients(net, None, views, patches, exact=True)
                for build, library in libraries.items():
                    with self.subTest(build, kind=kind.__name__, views=views, patches=patches):
                        blocks = fast.make_blocks(net, library)
                        got, fast_slopes = self.gradients(net, blocks, views, patches)
                        # bfloat16 has 8 bits: 0.4 % a rounding, summed over a dozen of layers.
                        self.assertLess((got - want).norm(), 0.01 * want.norm())
                        for name, slope in slopes.items():
                            apart = (fast_slopes[name] - slope).norm()
                            self.assertLess(apart, 0.08 * slope.norm() + 1e-7, name)

    def test_muon_in_c_steps_as_pytorch_does(self):
        for build, library in self.libraries().items():
            with self.subTest(build):
                self.check_muon(library)

    def check_muon(self, library):
        shapes, weights, optimisers = ((192, 64), (64, 64), (256, 64), (64, 256)), [], []
        for native in (None, library):
            torch.manual_seed(2)
            mine = [torch.nn.Parameter(0.02 * torch.randn(*shape)) for shape in shapes]
            weights.append(mine)
            optimisers.append(optim.Muon(mine, 1e-3, 0.05, parts={mine[0]: 3}))
            optimisers[-1].native = native
        start = [weight.detach().clone() for weight in weights[0]]
        for _ in range(3):
            for a, b in zip(*weights):
                a.grad = torch.randn_like(a)
                b.grad = a.grad.clone()
            for optimiser in optimisers:
                optimiser.step()
        for a, b, first in zip(*weights, start):
            self.assertLess((a - b).norm(), 0.05 * (a - first).norm())

    def test_a_gpu_draws_the_pictures_of_the_cpu(self):
        if not torch.cuda.is_available() or not os.path.exists(source.CUDA_LIBRARY):
            self.skipTest("no GPU, or libdio_sim_cuda.so was not built (-DDIO_CUDA=ON)")
        cpu = source.open_library(source.DEFAULT_LIBRARY).batch(900, 16, 4, (72, 40))
        gpu = source.open_library(device=torch.device("cuda", 0)).batch(900, 16, 4, (72, 40))
        for i in (1, 2):
            self.assertTrue(torch.equal(cpu[i], gpu[i]))
        apart = (cpu[0].int() - gpu[0].cpu().int()).abs()
        self.assertLess((apart > 0).float().mean().item(), 1e-3)

    def test_golden_cases_agree(self):
        shared = os.environ.get("DIO_SHARED_DIR")
        if not shared or not os.path.isdir(os.path.join(shared, "golden")):
            self.skipTest("DIO_SHARED_DIR is not set")
        self.assertEqual(checks.main(os.path.join(shared, "golden")), 0)


if __name__ == "__main__":
    if not torch:
        print("skipped: PyTorch is not installed (train/requirements.txt)")
        sys.exit(77)
    unittest.main()
