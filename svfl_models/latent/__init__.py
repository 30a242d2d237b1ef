"""Latent models of image, wrench and proprioception: VTT, PoE and concatenation, pretrained on episodes.

An encoder makes 288 numbers of each frame; a latent state (z1, z2) follows them through a sequence; from the state the
image, the reward, the next contact and the next proprioception are predicted, from the frame whether there is contact
and whether image and wrench belong together. ``svfl-train latent`` trains, `checkpoint.load_latent` opens, and
``module.network.encode(observations).feature`` is what others build on. The order of reading: `config`, `encoder` and
its three kinds `vtt`, `poe`, `concat`, `dynamics`, `losses`; then `data`, `module`, `train`.

What differs from the published code, and why:

- Images of 64 x 64 instead of 84 x 84, with depth: patches of 16 pixels (16 tokens instead of 36); PoE's and concat's
  last convolution has kernel 2 instead of 3; as published, none of the encoders can read 64 pixels.
- The wrench is a window of 64 readings instead of one: four tokens of 16 readings in VTT (instead of two of one
  reading), a tree over all readings in PoE and concat. Lee's encoder reads the oldest of its 32 only, because its
  convolutions pad on both sides; here a test follows the gradient to every reading.
- asinh of the wrench in units of its deviation, instead of a tanh of newtons, which cannot tell 3 N from 30 N.
- Proprioception is a third modality, which VTT lacks; the yaw enters as cosine and sine of its double.
- Contact and alignment are logits and have names; VTT's encoders return them as sigmoids, in two different orders.
- PoE takes the mean in evaluation and any of the modalities at any time; with a KL against N(0, I), which VTT's PoE
  lacks. Variances are at least 1e-4 (1e-8 there), means and raw variances are not bent by a LeakyReLU.
- The prior of a step starts from the posterior state before (as in the current reference code of SLAC); VTT's rolls out
  its own samples, so its KL is that of another model.
- The decoder's last layer has no LeakyReLU and counts from the mean image. The normal density per pixel is VTT's; depth
  is in units of 0.4 m.
- Rewards are 0 or 1: a cross-entropy, not a normal density. The end of an episode is not masked: it is where the reward
  is.
- Contact of a frame is a threshold on the force alone, in newtons; VTT mixes N and N m in one norm, at 15. On tasks as
  gentle as block picking (a held block weighs 1 N) 15 N is never reached, so `svfl_2023` takes 0.5 N; a label that
  never changes is refused. Contact of the *next* frame is read from the annotations of ``svfl-data relabel --contact``,
  or, if there are none, from the simulated object: what moves is touched.
- Pairs with a foreign wrench are made inside the batch, learned from in the same optimiser step, and cost no second
  look at images or wrenches. They are a derangement without neighbours in time and without two frames free of contact
  (`mismatch`); the gripper's pose stays with the image, so that only the wrench can give the pair away. VTT draws until
  two sets of windows are disjoint, which need not end; Lee freezes its pairs once.
- `lee_2020` has no optical flow to learn, since episodes hold none; pictures take its place and weight, and the latent
  dynamics are those of the other presets, over two frames.
- Splits are by episode. Lee's published trainer fits its validation files, and its split has 97 % of the trajectories
  on both sides.

Parameters, counted (`network.parameter_count`):

| encoder | published code | Kohler et al. say | here | why not equal |
| --- | --- | --- | --- | --- |
| VTT | 11,933,602 | 1.19e6 | 11,780,898 | 23 tokens instead of 40, larger patches; 1.19e6 may be a slip |
| PoE | 1,061,810 | 2.9e5 | 1,121,986 | a window's tree and a gripper's expert are more than one reading's layer |
| concat | 769,458 | - | 770,722 | likewise, and a smaller last kernel |

With dynamics, decoder and heads 14,808,270, 4,149,358 and 3,798,094 (published 15,442,855, 4,571,063, 4,278,711). How
the published encoders would shrink to 2.9e5 is not recorded anywhere.
"""
