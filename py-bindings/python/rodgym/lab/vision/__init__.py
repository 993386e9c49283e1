"""From a film to tracks: calibration by a board, markers, their order along the rod (OpenCV)."""

from rodgym.lab.vision.board import Board
from rodgym.lab.vision.camera import Camera, calibrate
from rodgym.lab.vision.markers import Look
from rodgym.lab.vision.track import Tracking, track

__all__ = ["Board", "Camera", "Look", "Tracking", "calibrate", "track"]
