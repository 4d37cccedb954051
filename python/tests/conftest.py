"""Fixtures that the tests share."""

import pytest

import diptych as dp

SIZE = (64, 36)


@pytest.fixture(scope="session")
def scene():
    return dp.load("builtin:cornell")


@pytest.fixture(scope="module")
def renderer(scene):
    return dp.Renderer(scene, size=SIZE, devices=dp.virtual(2), aov=["position", "depth", "normal"])
