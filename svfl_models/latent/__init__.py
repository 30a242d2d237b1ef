"""Latent models of image, wrench and proprioception: VTT, PoE and concatenation, pretrained on episodes.

An encoder maps each frame to a feature of 288 numbers, and a latent state (z1, z2) follows the features through a
sequence. The image, the reward, the next contact and the next proprioception are predicted from the state; whether
there is contact, and whether image and wrench belong together, is predicted from the frame. ``svfl-train latent``
trains a model, `checkpoint.load_latent` opens it, and other networks build on
``module.network.encode(observations).feature``. The files are best read in this order: `config`, `encoder` and its
three kinds `vtt`, `poe` and `concat`, `dynamics`, `losses`; then `data`, `module` and `train`.

The models differ from the published code in these points, for these reasons:

- Images have 64 x 64 pixels and depth instead of 84 x 84 pixels. VTT has patches of 16 pixels (16 tokens instead of
  36), and the last convolution of PoE and concat has kernel 2 instead of 3. None of the encoders can read 64 pixels as
  published.
- The wrench is a window of 64 readings instead of one reading. VTT has four tokens of 16 readings (instead of two of
  one reading), and PoE and concat have a tree over all readings. Lee's encoder reads only the oldest of its 32
  readings, because its convolutions pad on both sides; here a test follows the gradient to every reading.
- The wrench enters as asinh of its value in units of its deviation. The published code takes a tanh of newtons, which
  cannot tell 3 N from 30 N.
- Proprioception is a third modality, which VTT lacks. The yaw enters as cosine and sine of twice its value.
- Contact and alignment are logits with names; VTT's encoders return them as sigmoids, in two different orders.
- PoE takes the mean in evaluation and accepts any subset of the modalities at any time. It has a KL term against N(0,
  I), which VTT's PoE lacks. Variances are at least 1e-4 (1e-8 in the published code), and means and raw variances do
  not pass through a LeakyReLU.
- The prior of a step starts from the posterior state of the step before, as in the current reference code of SLAC.
  VTT's prior starts from its own samples, so its KL belongs to another model.
- The last layer of the decoder has no LeakyReLU, and its output is relative to the mean image. The normal density per
  pixel is VTT's; depth is in units of 0.4 m.
- Rewards are 0 or 1, so their loss is a cross-entropy and not a normal density. The end of an episode is not masked,
  because the reward is there.
- The contact of a frame is a threshold on the force alone, in newtons; VTT takes one norm over N and N m, with a
  threshold of 15. On gentle tasks such as block picking (a held block weighs 1 N) 15 N is never reached, so `svfl_2023`
  takes 0.5 N; a label that never changes is refused. The contact of the *next* frame is read from the annotations of
  ``svfl-data relabel --contact``. Without annotations it is read from the simulated object: an object that moves is
  touched.
- Pairs with a foreign wrench are made inside the batch and learned from in the same optimiser step, so that no image
  and no wrench is encoded twice. They are a derangement without pairs of frames that are close in time and without
  pairs of two frames free of contact (`mismatch`). The gripper's pose stays with the image, so that only the wrench can
  reveal the pair. VTT draws until two sets of windows are disjoint, which need not end; Lee draws its pairs only once.
- `lee_2020` has no optical flow to learn, since episodes hold none. Images take its place and weight, and the latent
  dynamics are those of the other presets, over two frames.
- Splits are by episode. Lee's published trainer fits its validation files, and its split has 97 % of the trajectories
  on both sides.

Numbers of parameters (`training.trainer.parameter_count`):

| encoder | published code | Kohler et al. say | here | why not equal |
| --- | --- | --- | --- | --- |
| VTT | 11,933,602 | 1.19e6 | 11,780,898 | 23 tokens instead of 40, larger patches; 1.19e6 may be a slip |
| PoE | 1,061,810 | 2.9e5 | 1,121,986 | tree over a window and expert for proprioception, not one layer for a reading |
| concat | 769,458 | - | 770,722 | the same as for PoE, and a smaller last kernel |

With dynamics, decoder and heads the numbers are 14,808,270, 4,149,358 and 3,798,094 (published: 15,442,855, 4,571,063
and 4,278,711). How the published encoders would shrink to 2.9e5 is not recorded anywhere.
"""
