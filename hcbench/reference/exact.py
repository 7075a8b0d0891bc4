"""Closed forms that follow from eq. (16); no ODE. (being written)"""
